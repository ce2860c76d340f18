"""What stands in the way of a landing: devices opened and measured, one finding for each fact.

Nothing here sends the vehicle anywhere. The gimbal is moved, but not while the vehicle is armed.
"""

import asyncio
import math
import statistics
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, NoReturn, Protocol, TypeVar

import numpy as np

from landerd.camera_model import CameraModel
from landerd.config import Config
from landerd.messages import (
    Attitude,
    AutopilotMessage,
    Frame,
    GimbalCommand,
    GimbalState,
    Heartbeat,
    LocalPosition,
    RcChannels,
)
from landerd.ports import Autopilot, Camera, DeviceLost, Gimbal

T = TypeVar("T")

CAMERA_S = 3.0  # how long each device is measured
GIMBAL_S = 1.0
GIMBAL_MOVE_S = 3.0
AUTOPILOT_S = 6.0
PARAMETER_S = 1.0  # until a parameter is asked for again
_SLOWEST_CAMERA_HZ = 10.0
_OLDEST_PICTURE_S = 0.2
_DARK, _BRIGHT = 12.0, 243.0  # mean brightness of a picture that shows nothing
_MOVE_DEG, _MOVED_DEG = 20.0, 5.0  # ordered, and taken as an answer


@dataclass(frozen=True)
class Finding:
    """One line of the check: what is so and why it matters, and how to mend it."""

    level: Literal["ok", "warn", "fail"]
    item: str
    what: str
    mend: str = ""


class VehicleParameters(Protocol):
    """An autopilot whose parameters can be asked for by name."""

    vehicle_parameters: Mapping[str, float]  # those that were answered
    counters: Mapping[str, int]  # of what was dropped, by kind

    def ask_parameter(self, name: str) -> None:
        """Ask for one; the answer comes with what `receive` takes in."""


async def _gather(receive: Callable[[], Awaitable[T]], seconds: float) -> list[tuple[float, T]]:
    """Return all that comes in this time, with the time of arrival. Raises DeviceLost."""
    loop = asyncio.get_running_loop()
    got: list[tuple[float, T]] = []
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            while True:
                message = await receive()
                got.append((loop.time(), message))
    return got


# ---- camera ------------------------------------------------------------------------------------


async def check_camera(camera: Camera, model: CameraModel, fps: float | None) -> list[Finding]:
    """Return what is found of a camera.

    Args:
        camera: closed; it is opened and closed again.
        model: the calibration at the size of the pictures.
        fps: asked of it; None: not known.
    """
    try:
        await camera.open()
        first = await camera.newest()  # the start of a stream is slow and not measured
        got = [(asyncio.get_running_loop().time(), first), *await _gather(camera.newest, CAMERA_S)]
    except DeviceLost as e:
        return [
            Finding(
                "fail",
                "camera",
                f"{e}: without pictures the pad is never seen",
                "plug it in, close other programs that use it, check camera.*.device",
            )
        ]
    finally:
        await camera.close()
    findings = [
        Finding("warn", "camera", remark, "see docs/cameras.md")
        for remark in getattr(camera, "remarks", ())
    ]
    found = [f for f in (_size(got, model), _rate(got, fps), _age(got), _light(got)) if f]
    height, width = got[-1][1].image.shape
    if not any(f.level == "fail" for f in found):
        rate = (len(got) - 1) / max(got[-1][0] - got[0][0], 1e-9)
        age_ms = 1e3 * statistics.median(t - frame.t for t, frame in got)
        text = f"{width}x{height}, {rate:.0f} pictures a second, {age_ms:.0f} ms old on arrival"
        found.insert(0, Finding("ok", "camera", text))
    return found + findings


_Frames = list[tuple[float, Frame]]


def _size(got: _Frames, model: CameraModel) -> Finding | None:
    height, width = got[-1][1].image.shape
    if (width, height) == (model.width, model.height):
        return None
    return Finding(
        "fail",
        "calibration",
        f"pictures are {width}x{height}, the calibration is for {model.width}x{model.height}: all "
        "directions would be wrong, so such pictures are not searched",
        "set the camera's size, or calibrate at this size: landerd calibrate camera",
    )


def _rate(got: _Frames, fps: float | None) -> Finding | None:
    rate = (len(got) - 1) / max(got[-1][0] - got[0][0], 1e-9) if len(got) > 1 else 0.0
    if rate >= 0.8 * (fps or _SLOWEST_CAMERA_HZ):
        return None
    wanted = f", {fps:g} were asked for" if fps else ""
    return Finding(
        "fail" if rate < _SLOWEST_CAMERA_HZ else "warn",
        "camera rate",
        f"{rate:.1f} pictures a second{wanted}: the pad's motion is seen late",
        "set a fixed, shorter exposure (cameras slow down in the dark), use a USB 3 port of its "
        "own, or a format with less data (MJPG)",
    )


def _age(got: _Frames) -> Finding | None:
    age = statistics.median(t - frame.t for t, frame in got)
    if -0.02 <= age <= _OLDEST_PICTURE_S:
        return None
    what = f"{age:.2f} s old on arrival" if age > 0 else f"stamped {-age:.2f} s in the future"
    return Finding(
        "warn" if 0 < age < 0.5 else "fail",
        "camera time",
        f"pictures are {what}: they are matched with the attitude of another moment",
        "set time_offset_s of the camera (docs/cameras.md), or use a camera without buffers",
    )


def _light(got: _Frames) -> Finding | None:
    first, last = got[0][1].image, got[-1][1].image
    mean = float(last.mean())
    if len(got) > 2 and np.array_equal(first, last) and np.ptp(last) > 0:
        return Finding(
            "warn",
            "camera picture",
            "all pictures are the same to the last bit: is it frozen?",
            "unplug it and plug it in again",
        )
    if _DARK <= mean <= _BRIGHT:
        return None
    return Finding(
        "warn",
        "camera picture",
        f"the picture is {'black' if mean < _DARK else 'white'}: nothing can be seen in it",
        "take the cap off; set exposure_s and gain for the light there is",
    )


# ---- gimbal ------------------------------------------------------------------------------------


async def check_gimbal(
    gimbal: Gimbal, config: Config, may_move: Callable[[], bool]
) -> list[Finding]:
    """Return what is found of a gimbal.

    Args:
        gimbal: closed; it is opened and closed again.
        config: limits and freshness.
        may_move: asked once, when it is known that it answers.
    """
    try:
        await gimbal.open()
        got = await _gather(gimbal.state, GIMBAL_S)
        if not got:
            raise DeviceLost("the gimbal says nothing of its angles")
        traits = getattr(gimbal, "traits", None)  # the real drivers state them
        findings = _gimbal_stream(got, config)
        if config.gimbal.driver == "fixed":
            return findings
        if not may_move():
            text = "not moved: the vehicle is armed, or it is not known to be disarmed"
            return [*findings, Finding("warn", "gimbal motion", text, "disarm and check again")]
        start = got[-1][1]
        if not start.pitch_measured or (traits and traits.feedback.value != "measured"):
            text = "has no feedback: whether it turns the right way cannot be measured"
            return [*findings, Finding("warn", "gimbal motion", text, "look: -90 is straight down")]
        return [*findings, *await _moves(gimbal, start, config)]
    except DeviceLost as e:
        return [
            Finding(
                "fail",
                "gimbal",
                f"{e}: where the camera looks would not be known",
                "check its power, wiring and gimbal.driver",
            )
        ]
    finally:
        await gimbal.close()


def _gimbal_stream(got: list[tuple[float, GimbalState]], config: Config) -> list[Finding]:
    rate = len(got) / GIMBAL_S
    age = statistics.median(t - state.t for t, state in got)
    limit = config.freshness.gimbal_s
    if rate * limit < 2.0 or age > limit:
        return [
            Finding(
                "fail",
                "gimbal rate",
                f"angles come {rate:.0f} times a second, {age:.2f} s old: older than {limit:g} s "
                "they are not flown on",
                "raise its rate, or the link's",
            )
        ]
    return [Finding("ok", "gimbal", f"angles come {rate:.0f} times a second")]


async def _moves(gimbal: Gimbal, start: GimbalState, config: Config) -> list[Finding]:
    """Order a change of pitch, then of yaw, and look which way the gimbal says it goes."""
    findings = []
    limits = {"pitch": config.gimbal.pitch_limits_deg, "yaw": config.gimbal.yaw_limits_deg}
    for axis, (low, high) in limits.items():
        now = math.degrees(getattr(start, axis))
        middle = 0.5 * (low + high)
        step = min(_MOVE_DEG, 0.4 * (high - low)) * (1.0 if now < middle else -1.0)
        if abs(step) <= _MOVED_DEG:
            continue
        target = {"yaw": start.yaw, "pitch": start.pitch, axis: math.radians(now + step)}
        gimbal.command(GimbalCommand(**target))
        states = await _gather(gimbal.state, GIMBAL_MOVE_S)
        gimbal.command(GimbalCommand(start.yaw, start.pitch))
        end = math.degrees(getattr(states[-1][1], axis)) if states else now
        moved = math.remainder(end - now, 360.0) * math.copysign(1.0, step)
        if moved < -_MOVED_DEG:
            findings.append(
                Finding(
                    "fail",
                    "gimbal motion",
                    f"{axis} moves the wrong way: {step:+.0f} degrees ordered, {end - now:+.0f} "
                    "came. The camera would turn away from the pad",
                    f"reverse its {axis}: {axis}_sign of the driver, or the servo's table",
                )
            )
        elif moved < _MOVED_DEG:
            findings.append(
                Finding(
                    "fail",
                    "gimbal motion",
                    f"{axis} does not follow: {step:+.0f} degrees ordered, {end - now:+.0f} came "
                    f"in {GIMBAL_MOVE_S:g} s",
                    "are its motors on, does its mode take orders, are the limits right?",
                )
            )
        await asyncio.sleep(0.5)
    return findings or [Finding("ok", "gimbal motion", "pitch and yaw follow orders")]


# ---- autopilot ---------------------------------------------------------------------------------


class AutopilotCheck:
    """Hears an autopilot for a while and says what it found.

    Attributes:
        disarmed: the last heartbeat said so; False while there was none.
    """

    def __init__(self, config: Config) -> None:
        self.disarmed = False
        self._config = config
        self._got: list[tuple[float, AutopilotMessage]] = []

    async def run(
        self, autopilot: Autopilot, parameters: VehicleParameters, others: asyncio.Event
    ) -> list[Finding]:
        """Return what is found; opens and closes the link.

        Args:
            autopilot: closed.
            parameters: the same, asked for its parameters.
            others: set when the link is no longer needed: a gimbal may be behind it.
        """
        names = list(judged_parameters(self._config))
        tasks: set[asyncio.Task[Any]] = set()
        try:
            await autopilot.open()
            listening = asyncio.create_task(self._listen(autopilot))
            tasks = {listening, asyncio.create_task(self._ask(autopilot, parameters, names))}
            await asyncio.wait({listening}, timeout=AUTOPILOT_S)
            if listening.done():
                listening.result()
            findings = self._judge(parameters)
            tasks.add(asyncio.create_task(others.wait()))
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            return findings
        except DeviceLost as e:
            return [
                Finding(
                    "fail",
                    "autopilot link",
                    f"{e}: landerd cannot fly without the autopilot",
                    "check autopilot.url, the cable, and group dialout",
                )
            ]
        finally:
            self.disarmed = False
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await autopilot.close()

    async def _listen(self, autopilot: Autopilot) -> NoReturn:
        loop = asyncio.get_running_loop()
        while True:
            message = await autopilot.receive()
            self._got.append((loop.time(), message))
            if isinstance(message, Heartbeat):
                self.disarmed = not message.armed

    def _judge(self, parameters: VehicleParameters) -> list[Finding]:
        if not self._of(Heartbeat):
            return [self._no_heartbeat(parameters.counters)]
        findings = [self._heartbeat(), *self._rates(), *self._gate()]
        return findings + parameter_findings(self._config, parameters.vehicle_parameters)

    async def _ask(
        self, autopilot: Autopilot, parameters: VehicleParameters, names: Sequence[str]
    ) -> NoReturn:
        while True:
            autopilot.heartbeat()
            for name in names:
                if name not in parameters.vehicle_parameters:
                    parameters.ask_parameter(name)
                    await asyncio.sleep(0.02)  # a slow link has the streams to carry too
            await asyncio.sleep(PARAMETER_S)

    def _of(self, kind: type[Any]) -> list[tuple[float, Any]]:
        return [(t, m) for t, m in self._got if isinstance(m, kind)]

    def _no_heartbeat(self, counters: Mapping[str, int]) -> Finding:
        system = self._config.autopilot.system_id
        if counters.get("foreign"):
            what = f"somebody speaks MAVLink, but not the autopilot of system {system}"
            return Finding("fail", "heartbeat", what, "set autopilot.system_id to SYSID_THISMAV")
        if counters:
            what = "bytes come, but they are not MAVLink that can be read"
            mend = "make the baud rate of autopilot.url that of SERIALn_BAUD; SERIALn_PROTOCOL 2"
            return Finding("fail", "heartbeat", f"{what} ({', '.join(counters)})", mend)
        what = f"nothing is heard at {self._config.autopilot.url}"
        mend = "is the autopilot on? SERIALn_PROTOCOL 2, TX and RX crossed, the right port and baud"
        return Finding("fail", "heartbeat", what, mend)

    def _heartbeat(self) -> Finding:
        beat: Heartbeat = self._of(Heartbeat)[-1][1]
        if beat.armed:
            what = f"the vehicle is armed, mode {beat.mode}"
            return Finding("warn", "heartbeat", what, "check before arming")
        return Finding("ok", "heartbeat", f"ArduCopter, disarmed, mode {beat.mode}")

    def _rates(self) -> list[Finding]:
        limits = self._config.freshness
        found = []
        for item, kind, limit, mend in (
            ("attitude", Attitude, limits.attitude_s, "a faster link; SRn_* 0"),
            ("position", LocalPosition, limits.position_s, "wait for GPS and EKF; a faster link"),
            ("RC channels", RcChannels, limits.rc_s, "switch the transmitter on; a faster link"),
        ):
            # The first second goes by until the streams run.
            got = [(t, m) for t, m in self._of(kind) if t > self._got[0][0] + 1.5]
            if not got:
                what = f"no {item} comes: landerd does not fly without"
                found.append(Finding("fail", item, what, mend))
                continue
            span = max(self._got[-1][0] - self._got[0][0] - 1.5, 1e-9)
            rate, age = len(got) / span, statistics.median(t - m.t for t, m in got)
            text = f"{rate:.0f} a second, {1e3 * age:.0f} ms old"
            if rate * limit < 2.0 or age > 0.5 * limit:
                what = f"{text}: data older than {limit:g} s are not flown on"
                found.append(Finding("fail", item, what, mend))
            else:
                found.append(Finding("ok", item, text))
        return found

    def _gate(self) -> list[Finding]:
        got = self._of(RcChannels)
        if not got:
            return []
        rc, last = self._config.rc, got[-1][1].channels_us
        pulse = last[rc.gate_channel - 1] if rc.gate_channel <= len(last) else 0
        name = f"RC {rc.gate_channel}"
        if pulse == 0:
            what = f"{name} has no signal: you could not hand over to landerd, nor take back"
            mend = "give the channel to a switch in the transmitter, or set rc.gate_channel"
            return [Finding("fail", "gate", what, mend)]
        if pulse > rc.gate_threshold_us:
            what = f"{name} is high ({pulse} us): landerd flies only after it was low"
            return [Finding("warn", "gate", what, "put the switch low; is it the right channel?")]
        return [Finding("ok", "gate", f"{name} is low ({pulse} us)")]


# ---- what in the autopilot's set-up would fight landerd ----------------------------------------


@dataclass(frozen=True)
class _Rule:
    good: Callable[[float], bool]
    level: Literal["warn", "fail"]
    why: str
    mend: str


def judged_parameters(config: Config) -> Mapping[str, _Rule]:
    """Return the autopilot's parameters that are judged, by name (docs/ardupilot.md)."""
    option = f"RC{config.rc.gate_channel}_OPTION"
    rules = {
        option: _Rule(
            lambda v: v == 0, "fail",
            "landerd's switch would do something else too", f"set {option} 0",
        ),
        "GUID_TIMEOUT": _Rule(
            lambda v: v <= 1.5, "warn",
            "the last velocity is flown on so many seconds when landerd dies",
            "set GUID_TIMEOUT 1",
        ),
        "WP_YAW_BEHAVIOR": _Rule(
            lambda v: v == 0, "warn",
            "the nose turns into the direction of travel, away from the pad's heading",
            "set WP_YAW_BEHAVIOR 0",
        ),
        "FS_THR_ENABLE": _Rule(
            lambda v: v != 0, "warn", "nothing happens when the transmitter is lost",
            "set FS_THR_ENABLE 1",
        ),
        "ARMING_CHECK": _Rule(
            lambda v: v != 0, "warn", "the autopilot arms whatever is wrong with it",
            "set ARMING_CHECK 1",
        ),
    }  # fmt: skip
    if config.guidance.output == "landing_target":
        for name in ("PLND_ENABLED", "PLND_TYPE"):
            why = "ArduPilot does not use landerd's targets"
            rules[name] = _Rule(lambda v: v == 1, "fail", why, f"set {name} 1")
    return rules


def parameter_findings(config: Config, values: Mapping[str, float]) -> list[Finding]:
    """Return what is wrong with the autopilot's parameters."""
    found = []
    rules = judged_parameters(config)
    for name, rule in rules.items():
        if name in values and not rule.good(values[name]):
            what = f"{name} is {values[name]:g}: {rule.why}"
            found.append(Finding(rule.level, "parameters", what, rule.mend))
    missing = [name for name in rules if name not in values]
    if missing:
        what = f"the autopilot did not tell {', '.join(missing)}"
        found.append(Finding("warn", "parameters", what, "compare them with docs/ardupilot.md"))
    return found or [Finding("ok", "parameters", f"{len(rules)} looked at, none fights landerd")]
