"""Who judges a simulated flight, and how the judges hear of it."""

import asyncio
import math

from hw.links.memory import MemoryLink
from hw.sim.judge.bounds import RuleBounds
from hw.sim.judge.rules import Rules, Truth
from hw.sim.judge.score import Score
from hw.sim.physics.world import World
from hw.sim.picture.view import Frustum, visible_markers
from hw.sim.snapshot import Snapshot
from hw.sim.stand_in.shared_link import SharedLink
from landerd.camera_model import CameraModel
from landerd.config.models import Config
from landerd.lander import Lander
from landerd.messages import Command, Frame, GimbalState, Input, Prior, Sightings
from landerd.pad import PadLayout


class Judge:
    """Shows score and rules the truth, the wire, and which pictures were delivered.

    An observer of the daemon only for the times of the gimbal's reports.
    """

    def __init__(
        self,
        config: Config,
        layout: PadLayout,
        camera_model: CameraModel,
        world: World,
        *,
        jitter_s: float,
    ) -> None:
        """jitter_s: of the control task on the loop's clock."""
        bounds = rule_bounds(config, has_heading=layout.has_heading, jitter_s=jitter_s)
        self.score = Score(world, world.airframe, layout.plate)
        self.rules = Rules(bounds, self._truth)
        self._world = world
        self._layout = layout
        self._frustum = Frustum(camera_model)
        self._link: MemoryLink | SharedLink | None = None

    def listen(self, link: MemoryLink | SharedLink) -> None:
        """Hear from now on what passes at landerd's end of a link."""
        self._link = link
        link.tap = self.rules.from_landerd
        link.heard = self.rules.to_landerd

    def stop_listening(self) -> None:
        """Leave the link alone."""
        if self._link is not None:
            self._link.tap = self._link.heard = None

    def on_delivered(self, frame: Frame, snapshot: Snapshot) -> None:
        """A picture was delivered; the truth at its exposure says whether a marker is in it."""
        if visible_markers(self._layout, self._frustum, snapshot.camera, snapshot.pad):
            self.rules.on_sighting(snapshot.t)
            self.score.on_sighting(snapshot.t)

    def on_flight(self, lander: Lander) -> None:
        """The core's opinion is not asked."""

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """What vision found does not matter here."""

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Note how old the gimbal's angles are."""
        if isinstance(message, GimbalState):
            self.rules.on_gimbal(message.t)

    def _truth(self) -> Truth:
        world = self._world
        world.advance(asyncio.get_running_loop().time())
        return Truth(
            t=world.t,
            distance=math.hypot(*world.offset),
            height=world.height,
            heading_error=world.heading_error,
            yaw=world.vehicle.yaw,
            pad_velocity=world.pad.velocity,
            feet_down=sum(world.vehicle.feet),
        )


def rule_bounds(config: Config, *, has_heading: bool, jitter_s: float) -> RuleBounds:
    """Return what the rules allow of a flight with this configuration.

    Args:
        config: has limits, freshness and the descent region.
        has_heading: the pad has.
        jitter_s: of the times at which set-points are seen.
    """
    guidance, fresh = config.guidance, config.freshness
    limits, descent = guidance.limits, guidance.descent
    return RuleBounds(
        control_period_s=1.0 / config.control.rate_hz,
        gate_channel=config.rc.gate_channel,
        gate_threshold_us=config.rc.gate_threshold_us,
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
        k1_m=descent.k1_m,
        k2_per_m=descent.k2_per_m,
        alignment_height_m=descent.alignment_height_m,
        has_heading=has_heading,
        jitter_s=jitter_s,
    )
