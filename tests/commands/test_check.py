"""`landerd check` on a good set-up and on broken ones: each is named, and how to mend it."""

import asyncio
import json
import math
import re
import socket
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import MavlinkCodec
from hw.autopilots.signing import Signing
from hw.links.memory import MemoryLink, memory_pair
from landerd.cli import main
from landerd.commands import check as check_command
from landerd.commands import shared
from landerd.commands.check import check
from landerd.config.files import Loaded, config_dir
from landerd.devices import make_devices
from landerd.drivers import read_configuration
from landerd.messages import Frame, GimbalCommand, GimbalState, Reference
from landerd.pad import Ring
from landerd.ports import DeviceLost, Feedback, GimbalTraits, NotInstalled
from landerd.preflight.configuration import first_flight
from landerd.preflight.finding import Finding
from landerd.runtime.clock import run_virtual
from landerd.runtime.daemon import Devices
from tests.hw.flight import PlainAirframe, plain_autopilot
from tests.quick_clock import run_quickly
from tests.vision.scenes import THESIS_CAMERA, U8, Optics, alone, look, render

GOOD_PARAMETERS = {
    "RC11_OPTION": 0.0,
    "GUID_TIMEOUT": 1.0,
    "GUID_OPTIONS": 0.0,
    "WP_YAW_BEHAVIOR": 0.0,
    "FS_THR_ENABLE": 1.0,
    "ARMING_CHECK": 1.0,
}
STATE = Path("/var/lib/landerd")
TRAITS = GimbalTraits(Reference.BODY, Feedback.MEASURED, 50.0, (-1.5, 1.5), (-math.pi, 0.0))


@dataclass
class Camera:
    """A camera that sends noise."""

    size: tuple[int, int] = (640, 480)
    fps: float = 30.0
    age_s: float = 0.05
    brightness: int = 128
    frozen: bool = False
    lost: bool = False
    lacks: str = ""
    remarks: tuple[str, ...] = ()
    shows: U8 | None = None

    async def open(self) -> None:
        self._seq = 0
        self._random = np.random.default_rng(0)
        if self.lost:
            raise DeviceLost("camera /dev/video0 is not there")
        if self.lacks:
            raise NotInstalled(
                "camera (gstreamer) needs GStreamer", f"sudo apt install {self.lacks}"
            )

    async def newest(self) -> Frame:
        await asyncio.sleep(1.0 / self.fps)
        self._seq += 1
        shape = (self.size[1], self.size[0])
        image = np.full(shape, self.brightness, np.uint8)
        if self.shows is not None:
            image = self.shows.copy()
        image[0] = (
            self._random.integers(0, 255, self.size[0])
            if not self.frozen
            else np.arange(self.size[0]) % 256
        )
        return Frame(asyncio.get_running_loop().time() - self.age_s, self._seq, image)

    async def close(self) -> None: ...


@dataclass
class Gimbal:
    """A gimbal that follows orders at once, unless a test breaks it."""

    sign: float = 1.0
    stuck: bool = False
    lost: bool = False
    rate_hz: float = 50.0
    measured: bool = True
    pitch: float = -0.4
    yaw: float = 0.0
    orders: int = 0
    traits: GimbalTraits = TRAITS

    async def open(self) -> None:
        if self.lost:
            raise DeviceLost("serial /dev/ttyUSB0: no such file")

    async def state(self) -> GimbalState:
        await asyncio.sleep(1.0 / self.rate_hz)
        now = asyncio.get_running_loop().time()
        return GimbalState(now, self.yaw, self.pitch, 0.0, Reference.BODY, self.measured)

    def command(self, command: GimbalCommand) -> None:
        self.orders += 1
        if not self.stuck:
            self.pitch = -0.4 + self.sign * (command.pitch + 0.4)
            self.yaw = command.yaw

    async def close(self) -> None: ...


class SetUp:
    """A vehicle on the ground with everything right; tests break it."""

    def __init__(self) -> None:
        self.camera, self.gimbal = Camera(), Gimbal()
        self.link, far = memory_pair()
        self.far: MemoryLink = far
        self.vehicle = plain_autopilot(PlainAirframe((0.0, 0.0, 0.0)), [far])
        self.vehicle.parameters = dict(GOOD_PARAMETERS)
        self.overrides: list[str] = []
        self.system = 1
        self.signing: Signing | None = None
        self.speaks = True
        self.state, self.system_root = STATE, Path("/nowhere")

    def check(self) -> list[Finding]:
        overrides = ["guidance.limits.speed_mps=3", *self.overrides]
        loaded = read_configuration(config_dir() / "default.yaml", overrides=overrides)
        driver = MavlinkAutopilot(self.link, system_id=self.system, signing=self.signing)

        async def run() -> list[Finding]:
            flying = asyncio.create_task(self.vehicle.run() if self.speaks else asyncio.sleep(60))
            try:
                devices = Devices(self.camera, self.gimbal, driver)
                return await check(loaded, devices, self.state, self.system_root)
            finally:
                flying.cancel()
                await asyncio.gather(flying, return_exceptions=True)

        return run_virtual(run())


def test_a_good_set_up_is_ready_and_the_gimbal_is_left_as_it_was() -> None:
    set_up = SetUp()
    findings = set_up.check()
    assert {f.item for f in findings if f.level == "ok"} >= {
        "heartbeat",
        "attitude",
        "position",
        "RC channels",
        "gate",
        "parameters",
        "camera",
        "gimbal",
        "gimbal motion",
    }
    assert [f for f in findings if f.level != "ok"] == []
    assert set_up.gimbal.pitch == pytest.approx(-0.4)
    assert set_up.gimbal.yaw == 0.0
    # nothing was sent that could move the vehicle
    assert set_up.vehicle.copter.armed is False


def set_of(name: str, value: object) -> Callable[[SetUp], None]:
    """Return a function that sets an attribute of a set-up, given by its dotted name."""

    def change(set_up: SetUp) -> None:
        *path, last = name.split(".")
        target: object = set_up
        for part in path:
            target = getattr(target, part)
        setattr(target, last, value)

    return change


def given(setting: str) -> Callable[[SetUp], None]:
    """Return a function that sets a key of a set-up's configuration."""

    def change(set_up: SetUp) -> None:
        set_up.overrides = [setting]

    return change


def no_signal(set_up: SetUp) -> None:
    set_up.vehicle.pilot.set(11, 0)


def gate_high(set_up: SetUp) -> None:
    set_up.vehicle.pilot.set(11, 1900)


def gate_in_its_middle(set_up: SetUp) -> None:
    set_up.overrides += ["rc.gate_threshold_us=1300", "rc.land_threshold_us=1700"]
    set_up.vehicle.pilot.set(11, 1500)


def taken_switch(set_up: SetUp) -> None:
    set_up.vehicle.parameters["RC11_OPTION"] = 31.0


def silent_at(url: str) -> Callable[[SetUp], None]:
    """Return a function that gives a set-up a silent autopilot at a URL."""

    def change(set_up: SetUp) -> None:
        set_up.speaks = False
        set_up.overrides = [f"autopilot.url={url}"]

    return change


def wrong_baud(set_up: SetUp) -> None:
    set_up.far.faults.corrupt = 0.5


def plane(set_up: SetUp) -> None:
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, 3, 81, 0, 3, 3)
    set_up.vehicle._heartbeat = lambda: beat  # type: ignore[method-assign]


def unsigned(set_up: SetUp) -> None:
    key = Path(tempfile.mkdtemp()) / "key"
    key.write_text("correct horse")
    key.chmod(0o600)
    set_up.signing = Signing(key, key.with_suffix(".time"))


def no_position(set_up: SetUp) -> None:
    set_up.vehicle.mute.add(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED)


def long_timeout(set_up: SetUp) -> None:
    set_up.vehicle.parameters["GUID_TIMEOUT"] = 5.0


def no_failsafe(set_up: SetUp) -> None:
    set_up.vehicle.parameters["FS_THR_ENABLE"] = 0.0


def soft(set_up: SetUp) -> None:
    set_up.vehicle.parameters["PSC_JERK_XY"] = 1.0


def fast(set_up: SetUp) -> None:
    set_up.overrides = ["guidance.limits.speed_mps=20"]


def ring_of_another_ratio(set_up: SetUp) -> None:
    ring = Ring(kind="whycon", outer_diameter_m=1.0, inner_ratio=0.55)
    view = look(THESIS_CAMERA, 3.0, 0.2, pixel=(300.0, 240.0))
    optics = Optics(background="grass")
    set_up.camera.shows = render(view, THESIS_CAMERA, optics, np.random.default_rng(1), alone(ring))


def real_camera(set_up: SetUp) -> None:
    set_up.overrides = ["camera.driver=v4l2"]


def folding_lens(set_up: SetUp) -> None:
    text = (config_dir() / "cameras" / "thesis.yaml").read_text()
    right, wrong = "[0.0576, -0.0321, 0.0041, -0.0203, 0.0]", "[0.0576, -0.1, 0.0041, -0.0203, 0.0]"
    assert right in text
    path = Path(tempfile.mkdtemp()) / "camera.yaml"
    path.write_text(text.replace(right, wrong))
    set_up.overrides = [f"camera.calibration={path}"]


_PADS = {  # what was entered wrongly of one that is delivered: from, to
    "edge": ("thesis", "position_m: [0.75, 0.0] ", "position_m: [0.95, 0.0] "),
    "apart": ("thesis", "position_m: [0.75, 0.0] ", "position_m: [0.55, 0.0] "),
    "nested": ("nested", "size_m: 0.18", "size_m: 0.45"),
    "bare": ("whycode", "outer_diameter_m: 0.45", "outer_diameter_m: 0.8"),
}


def pad_with(fault: str) -> Callable[[SetUp], None]:
    """Return a function that gives a set-up a wrong pad file."""

    def change(set_up: SetUp) -> None:
        name, right, wrong = _PADS[fault]
        text = (config_dir() / "pads" / f"{name}.yaml").read_text()
        assert right in text
        path = Path(tempfile.mkdtemp()) / "pad.yaml"
        path.write_text(text.replace(right, wrong))
        set_up.overrides = [f"pad.layout={path}"]

    return change


@pytest.mark.parametrize(
    ("change", "level", "item", "what", "mend"),
    [
        (set_of("camera.lost", True), "fail", "camera", "/dev/video0 is not there", "plug it in"),
        (set_of("camera.lacks", "gst"), "fail", "camera", "needs GStreamer", "apt install gst"),
        (set_of("camera.size", (640, 360)), "fail", "calibration", "640x360.*640x480", "calibrate"),
        (set_of("camera.fps", 5.0), "fail", "camera rate", "5.0 pictures", "exposure"),
        (set_of("camera.age_s", 0.4), "warn", "camera time", "0.40 s old", "time_offset_s"),
        (
            given("guidance.lost.after_s=0.1"),
            "fail",
            "camera in time",
            "0.08 s old.*0.0[56] s",
            "after_s",
        ),
        (
            given("estimation.clock_sigma_s=0.5"),
            "fail",
            "camera in time",
            "for 0.00 s",
            "clock_sigma",
        ),
        (
            given("guidance.descent.k2_per_m=0"),
            "fail",
            "descent region",
            "15 m up .* 0.16 m",
            "k1_m",
        ),
        (given("estimation.gimbal_sigma_deg=6"), "fail", "descent region", "no way down", "gimbal"),
        (
            given("vehicle.footprint_m=[1.1, 1.1]"),
            "warn",
            "feet",
            "0.78 m .* 0.62 m",
            "footprint_m",
        ),
        (
            given("vehicle.footprint_m=[0.8, 0.6]"),
            "warn",
            "feet",
            "0.2 m off, and 0.12 m off a foot",
            "commit_miss_m to 0.12",
        ),
        (
            given("vehicle.gear_height_m=1.0"),
            "warn",
            "feet",
            "no more than 4 degrees",
            "gear_height",
        ),
        (
            given("vehicle.camera_offset_m=[0, 0, 0.3]"),
            "fail",
            "feet",
            "0.10 m lower",
            "down is positive",
        ),
        (given("vision.focal_sigma=0.1"), "warn", "pad", "farther than 10 m", "focal_sigma"),
        (pad_with("bare"), "fail", "pad", "0.49 m up no marker fits", "small marker"),
        (given("gimbal.pitch_limits_deg=[-50, 0]"), "fail", "gimbal limits", "-50 to 0", "limits"),
        (set_of("camera.age_s", -0.1), "fail", "camera time", "in the future", "time_offset_s"),
        (set_of("camera.brightness", 0), "warn", "camera picture", "black", "cap"),
        (set_of("camera.frozen", True), "warn", "camera picture", "frozen", "unplug"),
        (set_of("camera.remarks", ("no gain",)), "warn", "camera", "no gain", "docs"),
        (set_of("gimbal.lost", True), "fail", "gimbal", "ttyUSB0", "wiring"),
        (set_of("gimbal.rate_hz", 3.0), "fail", "gimbal rate", "[23] times a second", "rate"),
        (set_of("gimbal.sign", -1.0), "fail", "gimbal motion", "pitch.*wrong way", "reverse"),
        (set_of("gimbal.stuck", True), "fail", "gimbal motion", "does not follow", "motors"),
        (set_of("gimbal.measured", False), "warn", "gimbal motion", "no feedback", "look"),
        (set_of("speaks", False), "fail", "heartbeat", "nothing is heard", "SERIALn_PROTOCOL"),
        (
            silent_at("udpin:0.0.0.0:14550"),
            "fail",
            "heartbeat",
            "nothing is heard",
            "send to this port",
        ),
        (
            silent_at("tcp:127.0.0.1:5760"),
            "fail",
            "heartbeat",
            "nothing is heard",
            "NET_Pn_PROTOCOL",
        ),
        (wrong_baud, "fail", "heartbeat", "not MAVLink that can be read", "baud"),
        (set_of("system", 7), "fail", "heartbeat", "not the autopilot of system", "SYSID_THISMAV"),
        (plane, "fail", "heartbeat", "system 1 says that it is not ArduCopter", "ArduCopter only"),
        (unsigned, "fail", "heartbeat", "not signed with autopilot.signing_key", "pass phrase"),
        (no_position, "fail", "position", "no position comes", "GPS"),
        (no_signal, "fail", "gate", "RC 11 has no signal", "transmitter"),
        (gate_high, "warn", "gate", r"high \(1900 us\)", "low"),
        (gate_in_its_middle, "warn", "gate", r"in its middle \(1500 us\)", "low"),
        (long_timeout, "fail", "parameters", "GUID_TIMEOUT is 5.*below 2.2 m", "GUID_TIMEOUT 1"),
        (no_failsafe, "fail", "parameters", "FS_THR_ENABLE is 0: .* flies on", "FS_THR_ENABLE 1"),
        (soft, "warn", "parameters", "PSC_JERK_XY is 1: .* 2.5 s late", "PSC_JERK_XY 5"),
        (fast, "warn", "speed limit", "up to 20 m/s", "speed_mps to 3"),
        (real_camera, "fail", "calibration", "thesis's camera and not yours", "calibrate camera"),
        (folding_lens, "warn", "calibration", "no inverse.* left out", "in the corners"),
        (pad_with("edge"), "warn", "pad", "apriltag 0 of 312 mm reaches over the edge", "measure"),
        (pad_with("apart"), "warn", "pad", "whycon.* and apriltag 0 .* over each other", "measure"),
        (pad_with("nested"), "warn", "pad", "whycon.* and apriltag 1 .* over each other", "sizes"),
        (
            ring_of_another_ratio,
            "warn",
            "pad",
            "in sight is a ring whose inner ratio is about 0.5.* file has 0.41",
            "mend its file",
        ),
        (taken_switch, "fail", "parameters", "RC11_OPTION is 31", "RC11_OPTION 0"),
        (set_of("vehicle.parameters", {}), "warn", "parameters", "did not tell", "docs"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_each_defect_of_a_set_up_is_reported_with_its_remedy(
    change: Callable[[SetUp], None], level: str, item: str, what: str, mend: str
) -> None:
    set_up = SetUp()
    change(set_up)
    findings = set_up.check()
    wrong = [f for f in findings if f.level != "ok" and f.item != "log"]
    assert [(f.level, f.item) for f in wrong if re.search(what, f.what)] != []
    for finding in wrong:
        assert finding.mend
        assert "\n" not in finding.what + finding.mend
    named = next(f for f in wrong if re.search(what, f.what))
    assert (named.level, named.item) == (level, item)
    assert mend in named.mend
    assert ("TX and RX" in named.mend) <= (not set_up.overrides)  # there are none on a network
    # and nothing that works is blamed; unless it is known to be disarmed nothing is moved
    unmoved = {"gimbal motion"} if item == "heartbeat" else set()
    assert {f.item for f in wrong} == {item} | unmoved


@pytest.mark.parametrize(
    ("device", "method"),
    [("camera", "open"), ("camera", "close"), ("gimbal", "state"), ("link", "open")],
)
def test_an_unexpected_error_of_a_driver_is_a_finding(
    monkeypatch: pytest.MonkeyPatch, device: str, method: str
) -> None:
    async def fail() -> None:
        raise ValueError("numpy.dtype\nsize changed")

    set_up = SetUp()
    monkeypatch.setattr(getattr(set_up, device), method, fail)
    findings = set_up.check()
    (failed,) = [f for f in findings if f.level == "fail"]
    assert failed.item == {"link": "autopilot link"}.get(device, device)
    assert "ValueError: numpy.dtype size changed" in failed.what
    assert "camera" in {f.item for f in findings if f.level == "ok"} or device == "camera"


@pytest.mark.parametrize(
    ("system", "has_key", "what", "mend"),
    [
        (2, False, "not the autopilot of system 1: system 2", "set autopilot.system_id"),
        (2, True, "not the autopilot of system 1: system 2", "set autopilot.system_id"),
        (1, True, "not signed with autopilot.signing_key", "pass phrase"),
        (None, False, "not MAVLink that can be read", "the right port"),
    ],
)
def test_a_sender_on_udp_that_is_ignored_is_reported(
    tmp_path: Path, system: int | None, has_key: bool, what: str, mend: str
) -> None:
    overrides = ["camera.driver=v4l2", "gimbal.driver=fixed"]
    if has_key:
        key = tmp_path / "key"
        key.write_text("correct horse")
        key.chmod(0o600)
        overrides.append(f"autopilot.signing_key={key}")
    datagram = b"no MAVLink"
    if system is not None:
        beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, 3, 81, 0, 3, 3)
        datagram = MavlinkCodec(system, 1).encode(beat)

    async def run() -> list[Finding]:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            vehicle.bind(("127.0.0.1", 0))
            port = vehicle.getsockname()[1]
        overrides.append(f"autopilot.url=udpin:127.0.0.1:{port}")
        loaded = read_configuration(config_dir() / "default.yaml", overrides=overrides)
        real = make_devices(loaded, tmp_path / "saved.yaml")
        devices = replace(real, camera=Camera(lost=True), gimbal=Gimbal(lost=True))
        checking = asyncio.create_task(check(loaded, devices, STATE, Path("/nowhere")))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            while not checking.done():
                vehicle.sendto(datagram, ("127.0.0.1", port))
                await asyncio.wait({checking}, timeout=0.5)
        return await checking

    (finding,) = (f for f in run_quickly(run(), rate=6.0) if f.item == "heartbeat")
    assert finding.level == "fail"
    assert what in finding.what
    assert mend in finding.mend


def flown_before(set_up: SetUp) -> None:
    set_up.overrides = ["guidance.limits.speed_mps=20"]
    set_up.state = Path(tempfile.mkdtemp())
    (set_up.state / "sensors.json").write_text("{}")


def own_lens(set_up: SetUp) -> None:
    text = (config_dir() / "cameras" / "thesis.yaml").read_text().replace("398.2", "421.7")
    path = Path(tempfile.mkdtemp()) / "camera.yaml"
    path.write_text(text)
    set_up.overrides = ["camera.driver=v4l2", f"camera.calibration={path}"]


@pytest.mark.parametrize(
    "sound",
    [
        lambda _: None,
        flown_before,
        own_lens,
        set_of("overrides", ["autopilot.url=udpin:127.0.0.1:14550"]),
        set_of("overrides", ["gimbal.driver=fixed"]),
        *(
            set_of("overrides", [f"pad.layout={path}"])
            for path in sorted((config_dir() / "pads").glob("*.yaml"))
        ),
    ],
)
def test_a_sound_set_up_has_no_warning(sound: Callable[[SetUp], None]) -> None:
    set_up = SetUp()
    sound(set_up)
    assert [f for f in set_up.check() if f.level != "ok" and f.item != "log"] == []


def test_the_gimbal_of_an_armed_vehicle_is_not_moved() -> None:
    set_up = SetUp()
    set_up.vehicle.copter.arm()
    findings = set_up.check()
    assert set_up.gimbal.orders == 0
    assert any(f.item == "gimbal motion" and "armed" in f.what for f in findings)
    assert any(f.item == "heartbeat" and f.level == "warn" for f in findings)


def test_a_fixed_camera_is_not_asked_to_move() -> None:
    set_up = SetUp()
    set_up.overrides = ["gimbal.driver=fixed"]
    findings = set_up.check()
    assert set_up.gimbal.orders == 0
    assert not any(f.item == "gimbal motion" for f in findings)


def test_json_has_findings_and_ready(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def two(*_: object) -> list[Finding]:
        return [Finding("ok", "gate", "RC 11 is low"), Finding("fail", "camera", "gone", "plug")]

    monkeypatch.setattr(check_command, "check", two)
    monkeypatch.setattr(check_command, "make_devices", lambda *_: None)
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"include: [{config_dir() / 'default.yaml'}]\n")
    assert main(["check", "-c", str(mine), "--json"]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    told = json.loads(line)
    assert told["ready"] is False
    assert told["findings"][1] == {
        "level": "fail", "item": "camera", "what": "gone", "mend": "plug",
    }  # fmt: skip
    assert main(["check", "-c", str(mine)]) == 1
    assert "FAIL camera: gone -> plug" in capsys.readouterr().out.splitlines()


def test_the_service_is_checked_with_what_a_ground_station_saved_for_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def speed_limit(loaded: Loaded, _devices: object, state: Path) -> list[Finding]:
        return first_flight(loaded.config, state)

    monkeypatch.setattr(check_command, "check", speed_limit)
    monkeypatch.setattr(check_command, "make_devices", lambda *_: None)
    monkeypatch.setattr(shared, "_SERVICE", tmp_path / "etc")
    monkeypatch.setattr(shared, "_STATE", tmp_path / "lib")
    saved = tmp_path / "lib" / "landerd" / "saved.yaml"
    for folder in (tmp_path / "etc", saved.parent):
        folder.mkdir(parents=True)
    saved.write_text("guidance: {limits: {speed_mps: 12.0}}\n")
    mine = tmp_path / "etc" / "landerd.yaml"
    mine.write_text(
        f"include: [{config_dir() / 'default.yaml'}]\nguidance: {{limits: {{speed_mps: 3.0}}}}\n"
    )
    main(["check", "-c", str(mine)])
    told = capsys.readouterr().out
    assert f"ok   saved parameters: {saved} is laid over" in told
    assert "speed limit: up to 12 m/s" in told
    beside = tmp_path / "landerd.yaml"  # no service's
    beside.write_text(mine.read_text())
    assert main(["check", "-c", str(beside)]) == 0
    assert capsys.readouterr().out == "ready\n"


@pytest.mark.parametrize("name", ["landerd", "landerd@boat"])
def test_saved_parameters_are_read_from_the_services_own_file(name: str) -> None:
    unit = (Path(__file__).parents[2] / "systemd" / "landerd.service").read_text()
    words = unit.replace("%N", name).split()
    config = Path(words[words.index("-c") + 1])
    assert shared.saved_file(config) == Path(words[words.index("--overlay") + 1])


def test_a_size_of_another_aspect_than_the_calibration_is_a_finding_and_not_a_crash() -> None:
    set_up = SetUp()
    set_up.overrides = ["camera.driver=v4l2", "camera.v4l2.height=360"]
    wrong = [f.what for f in set_up.check() if (f.level, f.item) == ("fail", "calibration")]
    assert any("another aspect" in what for what in wrong)
    assert math.isclose(set_up.gimbal.pitch, -0.4)


def test_unmeasured_servos_are_a_warning_and_their_reach_is_reported() -> None:
    set_up = SetUp()
    set_up.gimbal.traits = GimbalTraits(
        Reference.BODY, Feedback.MODELLED, 50.0, (0.0, 0.0), (math.radians(-100.0), 0.3)
    )
    set_up.overrides = ["gimbal.driver=servo_sysfs", "gimbal.pitch_limits_deg=[-150.0, 0.0]"]
    findings = [f for f in set_up.check() if f.item.startswith("gimbal ")]
    assert set_up.gimbal.orders == 0
    assert [(f.level, f.item, f.what) for f in findings if f.item == "gimbal limits"] == [
        (
            "ok",
            "gimbal limits",
            "gimbal.pitch_limits_deg: -150 to 0 is cut: servo_sysfs reaches -135 to 45",
        )
    ]
    assert ("warn", "gimbal motion") in [(f.level, f.item) for f in findings]


def test_a_full_disk_is_a_warning_but_the_services_log_folder_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    loaded = read_configuration(config_dir() / "default.yaml")
    found = check_command.disk(loaded, tmp_path / "landerd")
    assert (found.level, found.item) == ("ok", "log")
    assert f"the service records into {tmp_path}/landerd/logs" in found.what
    monkeypatch.setattr(check_command, "_LEAST_FREE_MB", 1e12)
    assert check_command.disk(loaded, tmp_path).mend == "delete old logs, or lower log.most_mb"
