"""The simulated gimbal as its electronics drive and measure it: the base of all device models."""

import asyncio
import math
from collections.abc import Callable
from random import Random

from hw.sim.options import SimGimbalOptions
from hw.sim.physics.world import World
from landerd.geometry import (
    Mat3,
    Vec3,
    angles_zxy,
    camera_mount,
    matmul,
    matmul_transposed,
    rot_zxy,
)
from landerd.messages import Reference


def _nobody(measured_t: float) -> None:
    """Do nothing with a report."""


class Play:
    """Backlash: the driven side of a gear moves only at either end of the play."""

    def __init__(self, width: float, angle: float) -> None:
        """Take the width of the play, rad, and the angle of both sides at the start, rad."""
        self._half = 0.5 * width
        self._angle = angle

    def follow(self, angle: float) -> float:
        """Return the driven side's angle for an angle of the driving side, rad."""
        if not self._half:
            return angle
        self._angle = min(max(self._angle, angle - self._half), angle + self._half)
        return self._angle


class SimMount:
    """Takes orders for the axes, and measures their angles with errors.

    Attributes:
        plant: the axes in the world.
        yaw_bias: constant error of the measured yaw, rad.
        pitch_bias: constant error of the measured pitch, rad.
        measured_t: time of the last measurement, s.
        reported: called when angles reach landerd, with the time of their measurement, s.
        slipped: fault: errors of measured yaw and pitch in addition to the biases, rad.
        reversed: fault: orders turn the axes in the opposite direction.
    """

    def __init__(self, world: World, options: SimGimbalOptions, rng: Random) -> None:
        """Take the world, the errors, and the source of their signs and of noise."""
        self.plant = world.gimbal
        self.reported: Callable[[float], None] = _nobody
        self.measured_t = -math.inf
        self.slipped = (0.0, 0.0)
        self.reversed = False
        self._world = world
        self._rng = rng
        self._noise = math.radians(options.noise_deg)
        self._scale = 1.0 + options.scale_error
        self._yaw_play = Play(math.radians(options.backlash_deg), self.plant.yaw.angle)
        self._pitch_play = Play(math.radians(options.backlash_deg), self.plant.pitch.angle)
        yaw_bias = pitch_bias = math.radians(options.bias_deg)
        if options.pitch_bias_deg is not None:
            pitch_bias = math.radians(options.pitch_bias_deg)
        self.yaw_bias = rng.choice((-yaw_bias, yaw_bias))
        self.pitch_bias = rng.choice((-pitch_bias, pitch_bias))
        mount = options.mount
        self._yaw_sign, self._pitch_sign = mount.yaw_sign, mount.pitch_sign
        self._yaw_zero = math.radians(mount.yaw_zero_deg)
        self._pitch_zero = math.radians(mount.pitch_zero_deg)

    def hidden_heading(self, camera_rotation_deg: tuple[float, float, float]) -> float:
        """Return by how much headings of what lies below are measured too large, rad.

        The error comes from the biases and from the camera's rotation on the last axis; no picture
        shows it.

        Args:
            camera_rotation_deg: roll, pitch, yaw of the camera on the last axis as configured.
        """
        said = matmul(
            rot_zxy(self.yaw_bias, 0.0, self.pitch_bias - 0.5 * math.pi),
            camera_mount(camera_rotation_deg),
        )
        is_so = matmul(rot_zxy(0.0, 0.0, -0.5 * math.pi), self.plant.R_gimbal_camera)
        R = matmul_transposed(said, is_so)
        return math.atan2(R[1][0], R[0][0])

    def advance(self) -> None:
        """Advance the world to the loop's time, as must be done before each order."""
        self._world.advance(asyncio.get_running_loop().time())

    def aim(self, yaw: float, pitch: float) -> None:
        """Order angles, rad."""
        self.advance()
        yaw_now, pitch_now = self._counted(self.plant.yaw.angle, self.plant.pitch.angle)
        if self.reversed:
            yaw, pitch = 2.0 * yaw_now - yaw, 2.0 * pitch_now - pitch
        self.plant.aim(
            self._yaw_sign * yaw + self._yaw_zero, self._pitch_sign * pitch + self._pitch_zero
        )

    def turn(self, yaw: float, pitch: float) -> None:
        """Order speeds, rad/s."""
        self.advance()
        self.plant.yaw.turn(self._yaw_sign * yaw)
        self.plant.pitch.turn(self._pitch_sign * pitch)

    def angles(self, reference: Reference) -> tuple[float, float]:
        """Return the true yaw and pitch, rad; the pitch against a reference."""
        plant = self.plant
        if reference is plant.reference:
            return plant.yaw.angle, plant.pitch.angle
        _, pitch, _ = angles_zxy(self.motion()[1])
        return plant.yaw.angle, pitch

    def motion(self, back_s: float = 0.0) -> tuple[float, Mat3, Vec3]:
        """Return the time, s, R_local_gimbal `back_s` ago, and the vehicle's velocity now.

        The velocity is in the local frame, m/s.
        """
        self.advance()
        world, plant = self._world, self.plant
        self.measured_t = world.t - back_s
        R_local_camera = world.snapshot(world.t - back_s).camera.R_local_camera
        R_local_gimbal = matmul_transposed(R_local_camera, plant.R_gimbal_camera)
        return world.t, R_local_gimbal, world.vehicle.velocity

    def bolt(self, yaw: float, pitch: float) -> None:
        """Fix the axes where these angles, rad, would be measured, apart from errors of zeros."""
        self.plant.yaw.bolt(yaw - self.yaw_bias + self._yaw_zero)
        self.plant.pitch.bolt(pitch - self.pitch_bias + self._pitch_zero)

    @property
    def rates(self) -> tuple[float, float]:
        """Speeds of yaw and pitch, rad/s."""
        return self._yaw_sign * self.plant.yaw.rate, self._pitch_sign * self.plant.pitch.rate

    @property
    def ordered(self) -> tuple[float, float]:
        """Yaw and pitch ordered last, rad, as the electronics count them."""
        return self._counted(self.plant.yaw.target, self.plant.pitch.target)

    def _counted(self, yaw: float, pitch: float) -> tuple[float, float]:
        """Return angles of the axes, rad, as the electronics count them: with sign and zero."""
        return self._yaw_sign * (yaw - self._yaw_zero), self._pitch_sign * (
            pitch - self._pitch_zero
        )

    def measure(self, *, pitch_measured: bool = True) -> tuple[float, float]:
        """Return the measured yaw and pitch, rad; without a pitch sensor, the ordered pitch."""
        self.advance()
        self.measured_t = self._world.t
        plant = self.plant
        yaw, pitch = self._counted(
            self._yaw_play.follow(plant.yaw.angle), self._pitch_play.follow(plant.pitch.angle)
        )
        yaw, pitch = self._scale * yaw, self._scale * pitch
        pitch = pitch if pitch_measured else self.ordered[1]
        return (
            yaw + self.yaw_bias + self.slipped[0] + self._rng.gauss(0.0, self._noise),
            pitch + self.pitch_bias + self.slipped[1] + self._rng.gauss(0.0, self._noise),
        )
