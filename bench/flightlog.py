"""Cost of recording: the control task's period, CPU and MB per minute for each image mode.

A scripted flight steps the core at its real rates in real time, and the recorder gets 30 simulated
pictures per second; vision does not run. The periods are meaningful only on an otherwise idle
machine; the control task's share of a core, on any machine.
"""

import asyncio
import tempfile
import time
from pathlib import Path

import numpy as np

from hw.sim.options import SimOptions
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.config.models import Config, LogSection
from landerd.drivers import read_configuration
from landerd.flightlog.contents import Head
from landerd.flightlog.reader import read_log
from landerd.flightlog.recorder import Recorder
from landerd.geometry import R_GIMBAL_CAMERA, matmul, rot_y, rot_z
from landerd.messages import Command, Frame, Input, Prior, Sightings
from landerd.pad import load_pad
from tests.scripted_flight import Flight

SECONDS = 10.0  # duration of the flight
FPS = 30.0
MODES = {
    "not recorded": None,
    "images: none": LogSection(images="none"),
    "jpeg, every 3rd": LogSection(),
    "jpeg, all": LogSection(every_nth=1),
    "lossless, every 3rd": LogSection(images="lossless"),
    "lossless, all": LogSection(images="lossless", every_nth=1),
}


def pictures() -> list[np.ndarray]:
    """Return ten pictures of the pad on grass from a height of 6 m."""
    loaded = read_configuration(config_dir() / "default.yaml")
    layout = load_pad(loaded.config.pad.layout)
    camera = load_camera(loaded.config.camera.calibration)
    sim = loaded.options["sim"]
    assert isinstance(sim, SimOptions)
    renderer = Renderer(layout, camera, sim.render, 1)
    pad = PadPose((0.0, 0.0, 0.0), rot_z(0.0))
    images = []
    for i in range(10):
        position = (-2.0, 0.1 * i, -6.0)
        pose = CameraPose(position, matmul(rot_y(np.radians(-70.0)), R_GIMBAL_CAMERA))
        body = VehiclePose(position, rot_z(0.0), (0.44, 0.26), 0.2)
        images.append(renderer.render(i, pose, pose, pad, body))
    return images


class Recorded(Flight):
    """A flight that passes to a recorder what the daemon would."""

    recorder: Recorder | None = None
    images: list[np.ndarray] = []  # noqa: RUF012 - set for each flight

    def give(self, message: Input) -> list[Command]:
        """Step the core with a message, and record both."""
        if isinstance(message, Sightings) and self.recorder is not None and message.seq % 4 != 0:
            image = self.images[message.seq % len(self.images)]
            self.recorder.on_frame(Frame(message.t, message.seq, image), Prior(), message)
        commands = super().give(message)
        if self.recorder is not None:
            self.recorder.on_step(self.t, message, commands)
        return commands


async def fly(flight: Recorded) -> list[float]:
    """Tick at 40 Hz; return the times between ticks, s."""
    loop = asyncio.get_running_loop()
    due = last = loop.time()
    periods: list[float] = []
    while len(periods) < SECONDS * 40:
        due = max(due + 0.025, loop.time())
        await asyncio.sleep(due - loop.time())
        now = loop.time()
        periods.append(now - last)
        last = now
        flight.tick()
    return periods


def main() -> None:
    """Print the table."""
    images = pictures()
    config = Config()
    head = Head(
        config,
        load_pad(config_dir() / "pads/thesis.yaml"),
        load_camera(config_dir() / "cameras/thesis.yaml"),
    )
    print(f"{'':20} p50 ms  p99 ms  control CPU %  all CPU %  MB/min  images dropped")
    for name, options in MODES.items():
        with tempfile.TemporaryDirectory() as folder:
            flight = Recorded()
            flight.images = images
            path = Path(folder) / "flight.mcap"
            if options is not None:
                flight.recorder = Recorder(head, options, path, background=True)
                flight.recorder.on_flight(flight.lander)
            own, cpu, wall = time.thread_time(), time.process_time(), time.monotonic()
            periods = sorted(asyncio.run(fly(flight)))
            wall = time.monotonic() - wall
            own, cpu = time.thread_time() - own, time.process_time() - cpu
            size, dropped = 0.0, 0
            if flight.recorder is not None:
                flight.recorder.close()
                size = path.stat().st_size / 1e6 * 60.0 / SECONDS
                lost = read_log(path).dropped
                dropped = lost.images if lost is not None else 0
            p50, p99 = (1e3 * periods[int(q * len(periods))] for q in (0.5, 0.99))
            print(
                f"{name:20} {p50:6.2f}  {p99:6.2f}  {100 * own / wall:13.1f}"
                f"  {100 * cpu / wall:9.1f}  {size:6.1f}  {dropped}"
            )


if __name__ == "__main__":
    main()
