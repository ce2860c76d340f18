"""Measures how fast a simulated landing runs, and how its time is spent.

Times are also given as multiples of that of OpenCV's ArUco detector on a full frame, measured in
the same run, so that machines can be compared.
"""

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.runtime.clock import run_virtual
from landerd.simulation.flight import Simulation


class Stopwatch:
    """Measures the times of calls of methods.

    Attributes:
        spent: times of all calls, s, by label.
    """

    def __init__(self) -> None:
        """Prepare; nothing is measured yet."""
        self.spent: dict[str, list[float]] = {}

    def wrap(self, owner: Any, name: str, label: str) -> None:
        """Replace the method `name` of an object by one that is timed under a label."""
        call: Callable[..., Any] = getattr(owner, name)
        times = self.spent.setdefault(label, [])

        def timed(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            try:
                return call(*args, **kwargs)
            finally:
                times.append(time.perf_counter() - start)

        setattr(owner, name, timed)


def main() -> None:
    """Fly one landing and print the figures."""
    loaded = read_configuration(
        config_dir() / "default.yaml", overlays=[config_dir() / "scenarios" / "stationary.yaml"]
    )
    simulation = Simulation(loaded, seed=1)
    watch = Stopwatch()
    watch.wrap(simulation.daemon._vision, "process", "vision")
    watch.wrap(simulation.camera.pictures, "render", "rendering")
    watch.wrap(simulation.daemon.lander, "step", "core, per message")
    start = time.perf_counter()
    run_virtual(simulation.run())
    wall = time.perf_counter() - start

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    detector = cv2.aruco.ArucoDetector(dictionary)
    _, frame, _ = next(iter(simulation.recording.views.values()))
    times = []
    for _ in range(20):
        at = time.perf_counter()
        detector.detectMarkers(frame.image)
        times.append(time.perf_counter() - at)
    unit = float(np.median(times))

    flown = simulation.world.t
    print(f"landing: {flown:.1f} s flown in {wall:.1f} s: {flown / wall:.1f} times real time")
    print(f"ArUco on a full frame: {1e3 * unit:.1f} ms, the unit of the last column")
    print(f"{'':20} {'calls':>6} {'total s':>8} {'median ms':>10} {'p95 ms':>8} {'units':>6}")
    for label, spent in watch.spent.items():
        median, p95 = np.percentile(spent, (50, 95))
        print(
            f"{label:20} {len(spent):6} {sum(spent):8.2f} {1e3 * median:10.2f} "
            f"{1e3 * p95:8.2f} {median / unit:6.2f}"
        )
    rest = wall - sum(sum(s) for s in watch.spent.values())
    print(f"{'all else':20} {'':6} {rest:8.2f}")


if __name__ == "__main__":
    main()
