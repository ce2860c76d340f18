"""Connects score, rules and safety monitor to the simulated world and the link.

They themselves are in `hw.sim.judge`.
"""

import asyncio
import math
from collections.abc import Callable

from hw.autopilots.arducopter import Mode
from hw.gimbals.servo_mavlink import ServoMavlinkOptions
from hw.sim.gimbals.mount import SimMount
from hw.sim.judge.bounds import RuleBounds
from hw.sim.judge.monitor import SafetyMonitor
from hw.sim.judge.reach import Reach
from hw.sim.judge.rules import Rules
from hw.sim.judge.score import Score
from hw.sim.judge.truth import Feet, Truth
from hw.sim.physics.world import World
from hw.sim.picture.view import Frustum, visible_markers
from hw.sim.snapshot import Snapshot
from landerd.camera_model import CameraModel
from landerd.config.files import Loaded
from landerd.devices import sim_options
from landerd.messages import Frame
from landerd.pad import PadLayout, size_m
from landerd.simulation.surroundings import Surroundings

# Least share of a marker's outline, or of one round its inner cells, with which a picture counts as
# a sighting by the rules: landerd may follow a tag of which only a corner or the middle is in view.
FOLLOWED_SHARE = 0.25


class Judge:
    """Passes truth, link bytes, delivered pictures and gimbal angles to score and rules."""

    def __init__(
        self, loaded: Loaded, layout: PadLayout, camera_model: CameraModel, around: Surroundings
    ) -> None:
        """Prepare to judge a flight; only the world is connected yet.

        Args:
            loaded: landerd's configuration, which the rules depend on.
            layout: of the pad in the world.
            camera_model: of the true lens.
            around: world, link and vehicle of the flight.
        """
        world = around.world
        bounds = rule_bounds(loaded, around, has_heading=layout.has_heading)
        self._feet = Feet(world, world.airframe, layout.plate)
        self.score = Score(world, self._feet)
        self.rules = Rules(bounds, self._truth)
        self.monitor = SafetyMonitor(
            world,
            self._feet,
            bounds,
            flies=lambda: self.rules.guided and self._is_in_guided,
            others_fly=lambda: (
                self.rules.in_another_mode or (self.rules.guided and not self._is_in_guided)
            ),
        )
        self.rules.on_order.append(self.monitor.on_order)
        self.rules.on_text.append(self.monitor.on_text)
        self._world = world
        self._layout = layout
        self._camera_rotation_deg = loaded.config.gimbal.camera_rotation_deg
        self._frustum = Frustum(camera_model)
        self._bounds = bounds
        self._link, self._vehicle = around.link, around.vehicle

    def listen(self) -> None:
        """Pass on, from now, what landerd sends and receives, and what the autopilot sends."""
        self._link.tap = self.rules.from_landerd
        self._link.heard = self.rules.to_landerd
        self._world.on_step.append(self._on_step)
        if self._vehicle is not None:
            self._vehicle.far.tap = self.rules.from_autopilot

    def watch(self, mount: SimMount) -> None:
        """Pass on, from now, when gimbal angles reach landerd, and when they were measured."""
        mount.reported = self.rules.on_gimbal
        self.rules.on_mounted(mount.hidden_heading(self._camera_rotation_deg))

    def watch_reach(self, can_see: Callable[[], bool]) -> Reach:
        """Watch, from now, whether the pad drives away while landerd cannot follow it.

        Args:
            can_see: tells whether no fault is present.
        """
        marker_px = self._frustum.camera.fx * max(map(size_m, self._layout.markers))
        return Reach(
            self._world,
            marker_px,
            self._bounds,
            lambda t: can_see() and self.rules.may_fly(t),
        )

    def stop_listening(self) -> None:
        """Stop to judge the link and the world: landerd does not fly any more."""
        self._link.tap = self._link.heard = None
        self._world.on_step.remove(self._on_step)
        if self._vehicle is not None:
            self._vehicle.far.tap = None

    def on_delivered(self, frame: Frame, snapshot: Snapshot) -> None:
        """Judge a delivered picture: the truth at its exposure shows whether a marker is in it."""
        view = self._layout, self._frustum, snapshot.camera, snapshot.pad
        is_shown = bool(visible_markers(*view))
        if is_shown or visible_markers(*view, FOLLOWED_SHARE, by_cells=True):
            self.rules.on_sighting(snapshot.t)
        if is_shown:
            self.score.on_sighting(snapshot.t)

    @property
    def _is_in_guided(self) -> bool:
        """Whether the simulated autopilot is in GUIDED, whatever landerd has heard.

        Of an autopilot outside this process it is not known, and True.
        """
        stand_in = self._vehicle.stand_in if self._vehicle is not None else None
        return stand_in is None or stand_in.copter.mode == Mode.GUIDED

    def _on_step(self, world: World) -> None:
        self.rules.on_feet(world.t, down=any(world.vehicle.feet))

    def _truth(self) -> Truth:
        self._world.advance(asyncio.get_running_loop().time())
        return self._feet.truth()


def rule_bounds(loaded: Loaded, around: Surroundings, *, has_heading: bool) -> RuleBounds:
    """Return the limits that the rules set for a flight with this configuration.

    Args:
        loaded: the configuration.
        around: world, link and vehicle of the flight.
        has_heading: whether the pad's markers show its heading.
    """
    config = loaded.config
    guidance, fresh = config.guidance, config.freshness
    limits, descent = guidance.limits, guidance.descent
    response = sim_options(loaded).response
    return RuleBounds(
        system_id=config.autopilot.system_id,
        ground_stations=frozenset(config.autopilot.ground_stations),
        servo_outputs=_servo_outputs(loaded),
        control_period_s=1.0 / config.control.rate_hz,
        gate_channel=config.rc.gate_channel,
        gate_threshold_us=config.rc.gate_threshold_us,
        land_threshold_us=config.rc.land_threshold_us,
        hold_height_m=guidance.hold.height_m,
        release_s=guidance.release_s,
        heartbeat_s=fresh.heartbeat_s,
        rc_s=fresh.rc_s,
        attitude_s=fresh.attitude_s,
        position_s=fresh.position_s,
        gimbal_s=fresh.gimbal_s,
        speed_mps=limits.speed_mps,
        climb_mps=limits.climb_mps,
        descent_mps=limits.descent_mps,
        acceleration_mps2=limits.acceleration_mps2,
        vertical_acceleration_mps2=limits.vertical_acceleration_mps2,
        jerk_mps3=limits.jerk_mps3,
        yaw_rate=math.radians(limits.yaw_rate_deg_s),
        braking_mps2=min(limits.acceleration_mps2, response.acceleration_mps2),
        vertical_braking_mps2=response.vertical_acceleration_mps2,
        k1_m=max(descent.k1_m, descent.widest_k1_m),
        k2_per_m=descent.k2_per_m,
        alignment_height_m=descent.alignment_height_m,
        has_heading=has_heading,
        guid_timeout_s=around.guid_timeout_s,
        stall_s=sim_options(loaded).companion.stall_s,
        jitter_s=around.jitter_s,
        commit_slip_mps=descent.commit_slip_mps,
        commits_at_m=descent.commit_height_m,
    )


def _servo_outputs(loaded: Loaded) -> frozenset[int]:
    """Return the numbers of the autopilot's outputs that move the gimbal."""
    options = loaded.options.get(f"gimbal.{loaded.config.gimbal.driver}")
    if not isinstance(options, ServoMavlinkOptions):
        return frozenset()
    return frozenset(axis.channel for axis in options.axes)
