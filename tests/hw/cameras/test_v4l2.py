"""The V4L2 driver above a node that behaves like the kernel's."""

import asyncio
import errno
import logging
import math
import os
import threading
import time
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.cameras.v4l2 import V4l2Camera, V4l2Options
from hw.cameras.v4l2_node import Layout, Mode, Range, Stamp, VideoNode
from hw.links.memory import memory_pair
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.config.models import Config
from landerd.messages import ExposureOrder, Frame, Prior, Sightings
from landerd.pad import load_pad
from landerd.ports import DeviceLost, ExposureControl
from landerd.runtime.daemon import Daemon, Devices
from landerd.runtime.observer import Observer
from tests.hw.cameras import fake_v4l2 as fake
from tests.hw.cameras.fake_v4l2 import FakeCamera
from tests.hw.idle import Idle


def camera(source: FakeCamera, **options: Any) -> V4l2Camera:
    return V4l2Camera(options=V4l2Options(width=64, height=48, **options), node=source.open)


def run(
    source: FakeCamera, use: Callable[[V4l2Camera], Awaitable[None]], **options: Any
) -> V4l2Camera:
    """Open a camera, use it and close it; nothing may stay open."""

    async def main() -> V4l2Camera:
        driver = camera(source, **options)
        await driver.open()
        await use(driver)
        await driver.close()
        await driver.close()
        return driver

    driver = asyncio.run(main())
    assert source.node is None
    return driver


def shoot_ago(source: FakeCamera, age_s: float) -> float:
    """Shoot a picture that is stamped so long ago; return that time on the loop's clock, s."""
    stamp = time.monotonic() - age_s
    source.shoot(t=stamp)
    return stamp + asyncio.get_running_loop().time() - time.monotonic()


@pytest.mark.parametrize("name", ["GREY", "NV12", "YUYV", "MJPG"])
@pytest.mark.parametrize("padding", [0, 6])
def test_every_format_gives_the_brightness(name: str, padding: int) -> None:
    source = FakeCamera([Mode(name, 64, 48, 30.0)], padding=padding)

    async def use(driver: V4l2Camera) -> None:
        source.shoot()
        frame = await driver.newest()
        assert frame.image.shape == (48, 64)
        assert frame.seq == 1
        assert abs(int(frame.image.min()) - 1) <= 1
        assert abs(int(frame.image.max()) - 1) <= 1

    run(source, use)


def test_after_a_pause_the_newest_picture_comes_and_no_older_one() -> None:
    source = FakeCamera()

    async def use(driver: V4l2Camera) -> None:
        for _ in range(30):
            source.shoot()
            await asyncio.sleep(0)  # the loop turns, but nobody asks for pictures
            await asyncio.sleep(0)
        assert (await driver.newest()).seq == 30
        waiting = asyncio.create_task(driver.newest())
        await asyncio.sleep(0.01)
        assert not waiting.done()  # never the same twice
        source.shoot()
        assert (await waiting).seq == 31

    run(source, use)


def test_pictures_that_piled_up_while_the_loop_was_late_are_skipped() -> None:
    source = FakeCamera()

    async def use(driver: V4l2Camera) -> None:
        for _ in range(3):
            source.shoot()
        frame = await driver.newest()
        assert frame.seq == 3
        assert frame.image.max() == 3

    run(source, use)


def test_after_the_loop_stood_still_no_picture_of_the_full_queue_is_given() -> None:
    source = FakeCamera()

    async def use(driver: V4l2Camera) -> None:
        source.shoot()
        await asyncio.sleep(0.01)  # held, and nobody has asked for it
        for _ in range(15):  # the kernel has room for three of them
            source.shoot()
        waiting = asyncio.create_task(driver.newest())
        await asyncio.sleep(0.05)
        assert not waiting.done()
        source.shoot()
        assert (await waiting).seq == 17
        # A machine that is always so late gets pictures all the same.
        for _ in range(10):
            source.shoot()
        waiting = asyncio.create_task(driver.newest())
        await asyncio.sleep(0.05)
        for _ in range(10):
            source.shoot()
        assert (await waiting).seq > 27

    run(source, use)


def test_under_load_a_picture_is_never_more_than_one_behind() -> None:
    """At 100 pictures a second, with searches of 25 ms in a thread, as the daemon runs them."""
    source = FakeCamera([Mode("YUYV", 64, 48, 100.0)])
    stop = threading.Event()
    behind = []

    def shoot() -> None:
        while not stop.wait(0.01):
            source.shoot()

    async def use(driver: V4l2Camera) -> None:
        shooting = threading.Thread(target=shoot)
        shooting.start()
        try:
            for search_s in [0.025] * 10 + [0.5, 0.025]:
                taken = await driver.newest()
                behind.append(source.sequence - taken.seq)
                await asyncio.to_thread(time.sleep, search_s)
        finally:
            stop.set()
            await asyncio.to_thread(shooting.join)

    run(source, use, fps=100.0)
    # On a machine so loaded that threads wait, single ones may be late; never the half second.
    assert sorted(behind)[len(behind) // 2] <= 1
    assert max(behind) < 20


@pytest.mark.parametrize(("stamp", "middle_s"), [(Stamp.START, +0.004), (Stamp.END, -0.004)])
def test_the_time_is_that_of_the_middle_of_the_exposure(stamp: Stamp, middle_s: float) -> None:
    source = FakeCamera(
        ranges={fake.EXPOSURE_AUTO: Range(0, 3), fake.EXPOSURE: Range(1, 5000)}, stamp=stamp
    )

    async def use(driver: V4l2Camera) -> None:
        shot = shoot_ago(source, 0.03)
        frame = await driver.newest()
        assert frame.t == pytest.approx(shot + middle_s + 0.002, abs=0.001)
        assert frame.sigma_t == 0.0

    run(source, use, exposure_s=0.008, time_offset_s=0.002)
    assert source.values == {fake.EXPOSURE_AUTO: 1, fake.EXPOSURE: 80}


def test_a_stamp_of_an_unknown_clock_counts_as_of_arrival() -> None:
    source = FakeCamera(stamp=Stamp.NONE)

    async def use(driver: V4l2Camera) -> None:
        source.shoot(t=1.0)
        frame = await driver.newest()
        assert abs(frame.t - asyncio.get_running_loop().time()) < 0.5
        assert frame.sigma_t > 1.0 / 30.0  # it was read out for up to a period

    run(source, use)


def test_with_an_exposure_that_is_not_known_the_time_is_less_sure() -> None:
    async def use(driver: V4l2Camera) -> None:
        source.shoot()
        assert (await driver.newest()).sigma_t == pytest.approx(0.0096, abs=1e-4)

    source = FakeCamera()
    run(source, use)


# ---- set-up ----


def test_the_format_of_least_work_that_is_fast_enough_is_taken() -> None:
    modes = [
        Mode("MJPG", 64, 48, 60.0),
        Mode("YUYV", 64, 48, 30.0),
        Mode("YUYV", 32, 24, 60.0),
        Mode("H264", 64, 48, 90.0),
    ]

    def taken(fps: float) -> int:
        source = FakeCamera(modes)
        sizes: list[int] = []

        async def use(driver: V4l2Camera) -> None:
            source.shoot()
            await driver.newest()
            assert source.node is not None
            sizes.append(source.node._layout.stride)

        run(source, use, fps=fps)
        return sizes[0]

    assert taken(30.0) == 128  # YUYV
    assert taken(60.0) == 64  # MJPG


def test_controls_are_set_and_values_that_the_camera_changed_are_remarked_on() -> None:
    source = FakeCamera(
        ranges={
            fake.EXPOSURE_AUTO: Range(0, 3),
            fake.EXPOSURE: Range(1, 50),
            fake.GAIN: Range(0, 100),
            fake.AUTOGAIN: Range(0, 1),
            fake.PRIORITY: Range(0, 1),
        },
        values={fake.AUTOGAIN: 1, fake.PRIORITY: 1},
    )

    async def use(driver: V4l2Camera) -> None:
        pass

    driver = run(source, use, exposure_s=0.008, gain=40, focus=12, fps=60.0)
    assert source.values[fake.EXPOSURE] == 50
    assert source.values[fake.GAIN] == 40
    assert source.values[fake.AUTOGAIN] == 0
    assert source.values[fake.PRIORITY] == 0
    said = "\n".join(driver.remarks)
    assert "asked for 80, it took 50 (from 1 to 50)" in said
    assert "focus: it has no such control" in said
    assert "fps: asked for 60, it gives 30" in said
    assert "gain" not in said
    assert len(driver.remarks) == 3


def test_automatic_exposure_and_focus_are_remarked_on() -> None:
    source = FakeCamera(
        ranges={fake.EXPOSURE_AUTO: Range(0, 3), fake.FOCUS_AUTO: Range(0, 1)},
        values={fake.FOCUS_AUTO: 1},
    )

    async def use(driver: V4l2Camera) -> None:
        pass

    driver = run(source, use)
    assert source.values[fake.EXPOSURE_AUTO] == 3
    assert [remark.split()[0] for remark in driver.remarks] == ["exposure", "autofocus"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"plugged": False}, "/dev/video0 is not there"),
        ({"busy": True}, "used by another program"),
        ({"full_bus": True}, "USB bandwidth"),
        ({"all_modes": [Mode("YUYV", 32, 24, 30.0)]}, "no 64x48.*it has 32x24 YUYV 30/s"),
    ],
)
def test_a_camera_that_cannot_be_used_says_why(change: dict[str, Any], said: str) -> None:
    source = FakeCamera(**change)

    async def use(driver: V4l2Camera) -> None:
        pass

    with pytest.raises(DeviceLost, match=said):
        run(source, use)
    assert source.node is None  # not left open


# ---- faults ----


def test_damaged_pictures_are_counted_and_not_flown_on() -> None:
    source = FakeCamera()

    async def use(driver: V4l2Camera) -> None:
        source.shoot(damaged=True)
        source.shoot()
        assert (await driver.newest()).seq == 2
        source.shoot()
        source.shoot(damaged=True)
        assert (await driver.newest()).seq == 3
        waiting = asyncio.create_task(driver.newest())
        source.shoot(short=True)
        await asyncio.sleep(0.01)
        source.shoot()
        assert (await waiting).seq == 6

    driver = run(source, use)
    assert driver.counters == {"damaged pictures": 2, "pictures that cannot be read": 1}


def test_half_a_jpeg_is_no_picture() -> None:
    source = FakeCamera([Mode("MJPG", 64, 48, 30.0)])

    async def use(driver: V4l2Camera) -> None:
        waiting = asyncio.create_task(driver.newest())
        source.shoot(short=True)
        await asyncio.sleep(0.01)
        source.shoot()
        assert (await waiting).seq == 2

    assert run(source, use).counters["pictures that cannot be read"] == 1


@pytest.mark.parametrize(
    "after_end", [b"", b"\xff" * 5, b"\x12\x34", b"\xff\xd9\x55", b"\0" * 4096]
)
def test_bytes_after_the_end_of_a_jpeg_are_ignored(after_end: bytes) -> None:
    source = FakeCamera(
        [Mode("MJPG", 64, 48, 30.0)], sends=lambda jpeg: jpeg.rstrip(b"\0") + after_end
    )

    async def use(driver: V4l2Camera) -> None:
        source.shoot()
        frame = await driver.newest()
        assert (frame.seq, int(frame.image.max())) == (1, 1)

    run(source, use)


SCAN, TABLES = b"\xff\xda", b"\xff\xdb"  # TABLES: of the picture, behind the thumbnail


@pytest.mark.parametrize("cut_at", [(SCAN, 30), (SCAN, 12), (TABLES, 0)])
def test_half_a_jpeg_with_a_thumbnail_is_no_picture(
    cut_at: tuple[bytes, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The end marker of the thumbnail is not the picture's, even if a decoder accepts it."""
    marker, behind = cut_at
    if marker == SCAN:
        monkeypatch.setattr(
            "hw.cameras.v4l2._decode_jpeg", lambda _, shape: np.zeros(shape, np.uint8)
        )

    def with_thumbnail(jpeg: bytes) -> bytes:
        thumbnail = fake.picture(Layout("MJPG", 16, 12, 16), 90).rstrip(b"\0")
        segment = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
        tables = jpeg.index(TABLES)
        return jpeg[:tables] + segment + jpeg[tables:]

    def cut(jpeg: bytes) -> bytes:
        whole = with_thumbnail(jpeg)
        return whole if source.sequence > 1 else whole[: whole.rindex(marker) + behind]

    source = FakeCamera([Mode("MJPG", 64, 48, 30.0)], sends=cut)

    async def use(driver: V4l2Camera) -> None:
        waiting = asyncio.create_task(driver.newest())
        source.shoot()
        await asyncio.sleep(0.05)
        source.shoot()
        assert (await waiting).seq == 2

    assert run(source, use).counters["pictures that cannot be read"] == 1


def test_a_camera_that_sends_nothing_that_can_be_read_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("hw.cameras.v4l2._STALL_S", 0.3)
    monkeypatch.setattr("hw.cameras.v4l2._FIRST_FRAME_S", 0.3)
    source = FakeCamera([Mode("MJPG", 64, 48, 30.0)])

    async def shoot() -> None:
        while True:
            source.shoot(short=True)
            await asyncio.sleep(0.02)

    async def use(driver: V4l2Camera) -> None:
        for has_sent in (False, True):
            if has_sent:
                source.shoot()
                await driver.newest()
            shooting = asyncio.create_task(shoot())
            async with asyncio.timeout(3.0):
                with pytest.raises(DeviceLost, match="nothing that can be read"):
                    await driver.newest()
            shooting.cancel()
            await driver.open()

    run(source, use)


def test_unplugged_it_is_lost_at_once_and_works_again_when_it_is_back() -> None:
    source = FakeCamera()

    async def use(driver: V4l2Camera) -> None:
        source.shoot()
        await driver.newest()
        waiting = asyncio.create_task(driver.newest())
        await asyncio.sleep(0)
        source.unplug()
        with pytest.raises(DeviceLost, match="has gone"):
            await waiting
        await driver.close()
        with pytest.raises(DeviceLost, match="is not there"):
            await driver.open()
        source.plugged = True
        await driver.open()
        source.shoot()
        assert (await driver.newest()).seq == source.sequence

    run(source, use)
    assert source.opened == 2


def test_a_camera_that_opens_after_nobody_waits_for_it_any_more_is_closed() -> None:
    source, asked, may_open = FakeCamera(), threading.Event(), threading.Event()

    def slow(path: str) -> VideoNode:
        asked.set()
        may_open.wait(5.0)
        return source.open(path)

    async def main() -> None:
        driver = V4l2Camera(options=V4l2Options(width=64, height=48), node=slow)
        opening = asyncio.create_task(driver.open())
        await asyncio.to_thread(asked.wait, 5.0)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        await driver.close()
        may_open.set()

    asyncio.run(main())
    end = time.monotonic() + 5.0
    while (source.opened < 1 or source.node is not None) and time.monotonic() < end:
        time.sleep(0.01)  # the thread that opens it closes it, when it gets to run
    assert source.opened == 1
    assert source.node is None


class Searched(Observer):
    """An observer that keeps the times at which pictures were searched."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.sightings: list[Sightings] = []

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        self.times.append(time.monotonic())
        self.sightings.append(sightings)


async def unplugged_and_plugged_in_again(source: FakeCamera) -> None:
    searched = Searched()

    async def shoot() -> None:
        while True:
            await asyncio.sleep(0.03)
            source.shoot()

    driver, idle = V4l2Camera(options=V4l2Options(), node=source.open), Idle()
    daemon = Daemon(
        Config(),
        load_pad(config_dir() / "pads" / "thesis.yaml"),
        load_camera(config_dir() / "cameras" / "thesis.yaml"),
        Devices(driver, idle, MavlinkAutopilot(memory_pair()[0])),
        observers=(searched,),
    )
    tasks = [asyncio.create_task(job) for job in (shoot(), daemon.run())]
    while len(searched.times) < 5:
        await asyncio.sleep(0.01)
    source.unplug()
    await asyncio.sleep(1.5)
    source.plugged = True
    plugged = time.monotonic()
    while searched.times[-1] < plugged:
        await asyncio.sleep(0.01)
    assert searched.times[-1] < plugged + 1.0
    # What the driver says of its times reaches the core.
    seen = searched.sightings[-1]
    assert seen.sigma_t > 0.0
    assert seen.arrived_t is not None
    assert 0.0 < seen.arrived_t - seen.t < 1.0
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def test_the_daemon_tells_of_the_outage_and_is_back_within_a_second(
    caplog: pytest.LogCaptureFixture,
) -> None:
    source = FakeCamera([Mode("YUYV", 640, 480, 30.0)])
    caplog.set_level(logging.INFO, "landerd")
    asyncio.run(asyncio.wait_for(unplugged_and_plugged_in_again(source), 20.0))
    told = [r.getMessage() for r in caplog.records if r.name == "landerd"]
    told = [line for line in told if line.startswith("camera")]
    assert told == [
        "camera lost: camera /dev/video0 has gone, or is no camera",
        "camera lost: camera /dev/video0 is not there",
        "camera is back",
    ]


def test_an_error_of_the_stream_and_a_poll_without_pictures_are_a_loss() -> None:
    source = FakeCamera()

    async def use(driver: V4l2Camera) -> None:
        source.break_off(errno.EIO)
        with pytest.raises(DeviceLost, match="fails"):
            await driver.newest()
        await driver.open()
        assert source.node is not None
        source.node.wake()  # readable for ever, and nothing to read
        with pytest.raises(DeviceLost, match="reports an error"):
            await driver.newest()

    run(source, use)


def test_a_stream_that_stands_still_is_a_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hw.cameras.v4l2._STALL_S", 0.05)
    source = FakeCamera()

    async def use(driver: V4l2Camera) -> None:
        source.shoot()
        await driver.newest()
        with pytest.raises(DeviceLost, match="sent no picture"):
            await driver.newest()

    run(source, use)


ADJUSTABLE = {
    fake.EXPOSURE_AUTO: Range(0, 3),
    fake.EXPOSURE: Range(1, 500),
    fake.GAIN: Range(0, 100),
    fake.AUTOGAIN: Range(0, 1),
}


async def carried_out() -> None:
    """Wait until the driver's thread has set the controls."""
    await asyncio.sleep(0.1)


def test_an_order_sets_exposure_and_gain_by_hand() -> None:
    source = FakeCamera(ranges=ADJUSTABLE, values={fake.AUTOGAIN: 1}, stamp=Stamp.START)

    async def use(driver: V4l2Camera) -> None:
        assert isinstance(driver, ExposureControl)
        driver.expose(ExposureOrder(0.004, 4.0))
        await carried_out()
        assert source.values[fake.EXPOSURE_AUTO] == 1
        assert source.values[fake.AUTOGAIN] == 0
        assert source.values[fake.EXPOSURE] == 40
        assert source.values[fake.GAIN] == 50  # two stops of four, in a range of 16
        shot = shoot_ago(source, 0.05)
        frame = await driver.newest()
        # The middle of the new exposure.
        assert frame.t == pytest.approx(shot + 0.002, abs=0.0015)

    run(source, use)


def test_gain_compensates_an_exposure_rounded_to_whole_units() -> None:
    source = FakeCamera(ranges=ADJUSTABLE)

    async def use(driver: V4l2Camera) -> None:
        driver.expose(ExposureOrder(0.00018, 1.0))
        await carried_out()
        assert source.values[fake.EXPOSURE] == 1
        assert source.values[fake.GAIN] == round(100 * math.log(1.8) / math.log(16.0))

    run(source, use)


def test_a_camera_without_gain_exposes_longer_but_keeps_its_rate() -> None:
    source = FakeCamera(ranges={fake.EXPOSURE: Range(1, 5000)})

    async def use(driver: V4l2Camera) -> None:
        driver.expose(ExposureOrder(0.004, 2.0))
        await carried_out()
        assert source.values[fake.EXPOSURE] == 80
        driver.expose(ExposureOrder(0.015, 8.0))
        await carried_out()
        assert source.values[fake.EXPOSURE] == 300  # 30 ms of 33

    run(source, use)


@pytest.mark.parametrize("error", [errno.EIO, errno.EACCES])
def test_a_camera_that_refuses_its_gain_exposes_longer_and_is_dated_so(error: int) -> None:
    source = FakeCamera(ranges=ADJUSTABLE, refused={fake.GAIN: error}, stamp=Stamp.START)

    async def use(driver: V4l2Camera) -> None:
        for _ in range(2):
            driver.expose(ExposureOrder(0.015, 8.0))
            await carried_out()
        assert source.values[fake.EXPOSURE] == 300  # 30 ms of 33
        shot = shoot_ago(source, 0.05)
        frame = await driver.newest()
        assert frame.t == pytest.approx(shot + 0.015, abs=0.0015)

    driver = run(source, use, exposure_s=0.004)
    told = [remark for remark in driver.remarks if remark.startswith("gain: it takes no orders")]
    assert len(told) == len(driver.remarks) == 1


def test_of_orders_that_come_too_fast_the_newest_counts() -> None:
    source = FakeCamera(ranges=ADJUSTABLE)

    async def use(driver: V4l2Camera) -> None:
        for ms in range(1, 20):
            driver.expose(ExposureOrder(1e-3 * ms, 1.0))
        await carried_out()
        assert source.values[fake.EXPOSURE] == 190

    run(source, use)


def test_a_camera_that_comes_back_exposes_as_it_was_ordered() -> None:
    source = FakeCamera(ranges=ADJUSTABLE)

    async def use(driver: V4l2Camera) -> None:
        driver.expose(ExposureOrder(0.003, 1.0))
        await carried_out()
        source.values[fake.EXPOSURE] = 7
        await driver.open()
        await carried_out()
        assert source.values[fake.EXPOSURE] == 30

    run(source, use)


def test_a_camera_that_refuses_orders_is_remarked_on_and_goes_on() -> None:
    source = FakeCamera()

    async def use(driver: V4l2Camera) -> None:
        for _ in range(2):
            driver.expose(ExposureOrder(0.003, 1.0))
            await carried_out()
        source.shoot()
        assert (await driver.newest()).seq == 1

    driver = run(source, use)
    assert sum("does not take orders" in remark for remark in driver.remarks) == 1


def test_a_camera_whose_exposure_cannot_be_set_keeps_its_own_automatic() -> None:
    automatic = 3
    source = FakeCamera(
        ranges={fake.EXPOSURE_AUTO: Range(0, 3), fake.AUTOGAIN: Range(0, 1)},
        values={fake.EXPOSURE_AUTO: automatic, fake.AUTOGAIN: 1},
    )

    async def use(driver: V4l2Camera) -> None:
        driver.expose(ExposureOrder(0.003, 1.0))
        await carried_out()
        assert source.values[fake.EXPOSURE_AUTO] != 1
        assert source.values[fake.AUTOGAIN] == 1

    driver = run(source, use)
    assert any("does not take orders" in remark for remark in driver.remarks)


@pytest.mark.parametrize("hangs", ["open", "close", "set_control"])
def test_a_camera_that_hangs_does_not_keep_the_process_from_ending(hangs: str) -> None:
    """Otherwise systemd kills the service after TimeoutStopSec, 6 s, and the log lacks its end."""
    source, hung, let_go = FakeCamera(ranges=ADJUSTABLE), threading.Event(), threading.Event()

    def hang(*_: object) -> Any:
        hung.set()
        let_go.wait(8.0)
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    def open_node(path: str) -> VideoNode:
        if hangs == "open":
            hang()
        return source.open(path)

    async def fly() -> float:
        driver = V4l2Camera(options=V4l2Options(width=64, height=48), node=open_node)
        daemon = Daemon(
            Config(),
            load_pad(config_dir() / "pads" / "thesis.yaml"),
            load_camera(config_dir() / "cameras" / "thesis.yaml"),
            Devices(driver, Idle(), MavlinkAutopilot(memory_pair()[0])),
        )
        flying = asyncio.create_task(daemon.run())
        await asyncio.sleep(0.3)
        if source.node is not None:
            setattr(source.node, hangs, hang)
            driver.expose(ExposureOrder(0.004, 1.0))
        await asyncio.sleep(0.3)
        ending = time.monotonic()
        flying.cancel()
        await asyncio.gather(flying, return_exceptions=True)
        return ending

    try:
        ending = asyncio.run(fly())
        assert hung.is_set()
        assert time.monotonic() - ending < 2.0
    finally:
        let_go.set()
