"""Detects that the pad left the camera's reach while landerd could not follow it.

While landerd may not fly, or knows too little to, the vehicle stops (docs/safety.md, 1b and 1d) and
the pad drives on. Where it cannot be seen any more from there, or not until it is caught up with,
no landing can be expected. Told by truth and the wire alone.
"""

import math
from collections.abc import Callable

from hw.sim.judge.bounds import RuleBounds
from hw.sim.physics.world import World
from landerd.geometry import sub

LOOKS_S = 0.1
_MOST_STEPS = 200  # of LOOKS_S until the fastest pad is caught up with
# Seen at so flat an angle, or from so far, that it is narrower than this, px, a ring is not found:
# of those of 4.4 px half are (landerd.simulation.sight.statistics, measured by bench.sight).
LEAST_PX = 4.0
NOTICED_S = 0.5  # a pad that is seen again is flown to after so long, at the earliest


class Reach:
    """Hangs on the world's steps.

    Attributes:
        left_t: when landerd could fly on to the pad, and that was out of reach, s; None: never.
    """

    def __init__(
        self,
        world: World,
        marker_px: float,
        bounds: RuleBounds,
        can_follow: Callable[[float], bool],
    ) -> None:
        """Watch from now on.

        Args:
            world: the truth.
            marker_px: width of the pad's largest marker in the picture, seen squarely from 1 m.
            bounds: how fast landerd may speed up and climb.
            can_follow: nothing keeps landerd from flying after the pad at a time, s.
        """
        self.left_t: float | None = None
        self._marker_px, self._b, self._can_follow = marker_px, bounds, can_follow
        self._followed = False  # it could be, when landerd could last
        self._waits = False  # landerd cannot
        self._next_t = -math.inf
        world.on_step.append(self._on_step)

    def _on_step(self, world: World) -> None:
        if any(world.vehicle.feet) and not world.vehicle.on_pad:
            self._followed = False  # what touches the ground has not lost the pad that way
        if world.t < self._next_t:
            return
        self._next_t = world.t + LOOKS_S
        if not self._can_follow(world.t):
            self._waits = True
            return
        is_out = self._is_out(world)
        if self._waits and self._followed and is_out and self.left_t is None:
            self.left_t = world.t
        self._waits, self._followed = False, not is_out

    def _is_out(self, world: World) -> bool:
        """Tell whether the pad gets out of reach before it can be caught up with.

        By the best that the limits allow: seen again, it is flown after with full acceleration, and
        climbed, which shows it less flat.
        """
        north, east = world.offset
        away, height = math.hypot(north, east), max(0.0, world.height)
        v_north, v_east, _ = sub(world.vehicle.velocity, world.pad.velocity)
        leaves = (north * v_north + east * v_east) / max(away, 1e-9)
        b, climbs = self._b, 0.0
        for step in range(_MOST_STEPS):
            if self._marker_px * height < LEAST_PX * (away * away + height * height):
                return True
            if leaves <= 0.0:
                break
            away, height = away + leaves * LOOKS_S, height + climbs * LOOKS_S
            if step * LOOKS_S >= NOTICED_S:
                leaves -= b.braking_mps2 * LOOKS_S
                climbs = min(b.climb_mps, climbs + b.vertical_acceleration_mps2 * LOOKS_S)
        return False
