"""A flight for the core alone: messages from a plain world in, commands back into it.

No images, no daemon, no bytes: the world knows where pad and vehicle are and says so in the core's
own messages, at the core's control rate. What goes wrong is set by the test.
"""

import math
from collections.abc import Callable
from dataclasses import replace

from landerd.config.models import Config
from landerd.geometry import (
    IDENTITY,
    R_GIMBAL_CAMERA,
    Mat3,
    Vec3,
    add,
    horizontal,
    matmul,
    matscale,
    rot_zyx,
    rotate,
    scale,
    sub,
    transpose,
    wrap,
)
from landerd.guidance.phases import descent_radius
from landerd.lander import Lander
from landerd.messages import (
    Attitude,
    AutopilotRestarted,
    Command,
    Disarm,
    GimbalCommand,
    GimbalState,
    Heartbeat,
    Input,
    Landed,
    LandedState,
    LocalPosition,
    MarkerSighting,
    Phase,
    PhaseChange,
    PoseSolution,
    PressDown,
    RcChannels,
    Reference,
    Setpoint,
    Sightings,
    StatusText,
    Tick,
)
from landerd.pad import PadLayout, Plate, Ring, Square

DT = 0.025
LATE_TICKS = 2  # from exposure to the sighting
VELOCITY_LAG_S, YAW_LAG_S, GIMBAL_LAG_S = 0.3, 0.2, 0.08
LANDED_AFTER_S = 1.5  # the land detector, from contact
LOW, HIGH = 1100, 1900

RING = Ring(kind="whycon", outer_diameter_m=1.0)
TAG = Square(kind="apriltag", dictionary="APRILTAG_36h11", id=0, size_m=0.3)
PLATE = Plate(north_m=1.0, south_m=0.6, east_m=0.6, west_m=0.6)
PAD = PadLayout(name="ring and tag", markers=(RING, TAG), plate=PLATE)
RING_PAD = PadLayout(name="ring", markers=(RING,), plate=PLATE)


class Flight:
    """Vehicle, pilot, pad and core. Attributes above the line may be set while it flies."""

    def __init__(
        self,
        *,
        config: Config | None = None,
        layout: PadLayout = PAD,
        position: Vec3 = (-6.0, 2.0, -8.0),
        pad_velocity: Vec3 = (0.0, 0.0, 0.0),
    ) -> None:
        self.visible = True
        self.distort: Callable[[PoseSolution], PoseSolution] = lambda true: true
        self.silent: set[type] = set()  # kinds of messages that do not come
        self.detects_landing = True
        self.pitch = self.pitch_rate = 0.0  # what the autopilot says; pictures are taken level
        self.lean = 0.0  # of the airframe really, rad; its camera leans with it
        self.slope = 0.0  # of the pad, down to its north, rad: its normal and north alone show it
        self.skids = 0.0  # m/s across the pad once it touches
        self.told_to_sink = 0.0  # m/s that the autopilot takes itself to sink faster than it does
        self.pulse_us = LOW
        self.armed, self.mode = True, "GUIDED"
        self.order = Setpoint((0.0, 0.0, 0.0), 0.0)  # the last one, a ground station's at first
        self.pad_heading = 0.6
        # --------
        self.config = config or Config()
        self.layout = layout
        self.lander = Lander(self.config, layout)
        self.t = 100.0
        self.position, self.velocity = position, (0.0, 0.0, 0.0)
        self.yaw = self.yaw_rate = 0.0
        self.pad: Vec3 = (0.0, 0.0, 0.0)
        self.pad_velocity = pad_velocity
        self.gimbal = GimbalCommand(0.0, math.radians(-45.0))
        self.contact_t: float | None = None
        self.inputs: list[Input] = []
        self.commands: list[Command] = []
        self.setpoints: list[tuple[float, Setpoint]] = []
        self.pressed: list[PressDown] = []
        self.texts: list[str] = []
        self.phases: list[Phase] = []
        self.disarm_orders: list[float] = []
        self._aimed = self.gimbal
        self._late: list[Sightings] = []
        self._ticks = 0
        self._beat: Heartbeat | None = None

    # ---- what a test asks ----------------------------------------------------------------------

    @property
    def feet(self) -> Vec3:
        down = (0.0, 0.0, self.config.vehicle.gear_height_m)
        return add(self.position, rotate(rot_zyx(self.yaw, self.lean, 0.0), down))

    @property
    def distance(self) -> float:
        return horizontal(sub(self.pad, self.feet))

    @property
    def height(self) -> float:
        return self.pad[2] - self.feet[2]

    @property
    def heading_error(self) -> float:
        return wrap(self.pad_heading - self.yaw)

    # ---- flying --------------------------------------------------------------------------------

    def run(self, seconds: float) -> list[Setpoint]:
        """Fly on; return the set-points of this time."""
        before = len(self.setpoints)
        for _ in range(round(seconds / DT)):
            self.tick()
        return [s for _, s in self.setpoints[before:]]

    def run_in_gusts(self, seconds: float) -> None:
        """Fly on, carried to and fro by 0.75 m."""
        for k in range(round(seconds / DT)):
            north, east, down = self.position
            self.position = (north + 1.5 * DT * math.cos(2.0 * k * DT), east, down)
            self.tick()

    def until(self, phase: Phase, *, at_most_s: float = 60.0) -> "Flight":
        """Fly on until the core is in a phase."""
        end = self.t + at_most_s
        while self.lander.phase is not phase:
            assert self.t < end, f"{self.lander.phase} and not {phase}: {self.lander.reason}"
            self.tick()
        return self

    def until_contact(self) -> "Flight":
        """Fly on until the feet stand on the pad's plane."""
        self.until(Phase.LANDED)
        while self.contact_t is None:
            self.tick()
        return self

    def engaged(self) -> "Flight":
        """The pilot moves the switch, and landerd flies."""
        self.pulse_us = LOW
        self.run(1.1)
        self.pulse_us = HIGH
        assert self.run(0.5), self.lander.reason
        return self

    def tick(self) -> None:
        """One control period: the world moves, its messages arrive, the core answers."""
        self._go_on()
        self.give(Tick(self.t))

    def held_up(self, seconds: float) -> None:
        """Fly on without a control step but for one at the end: all is read before it."""
        for _ in range(round(seconds / DT)):
            self._go_on()
        self.give(Tick(self.t))

    def _go_on(self) -> None:
        self.t += DT
        self._ticks += 1
        self._move()
        for message in self._telemetry():
            self.give(message)
        unseen = Sightings(self.t, self._ticks, (), ())
        self._late.append(self.sighting() if self.visible else unseen)
        while self._late and self._late[0].t <= self.t - LATE_TICKS * DT + 1e-9:
            self.give(self._late.pop(0))

    def give(self, message: Input) -> list[Command]:
        """Give the core a message and carry out what it orders."""
        if type(message) in self.silent:
            return []
        self.inputs.append(message)
        commands = self.lander.step(message)
        self.commands += commands
        for command in commands:
            self._carry_out(command)
        return commands

    def restart_autopilot(self) -> None:
        """It boots and comes back as it was."""
        self.give(AutopilotRestarted(self.t))
        self._beat = None

    def sighting(self) -> Sightings:
        """What a picture exposed now shows."""
        R = transpose(self.R_local_camera())
        offset = rotate(rot_zyx(self.yaw, self.lean, 0.0), self.config.vehicle.camera_offset_m)
        position = rotate(R, sub(self.pad, add(self.position, offset)))
        R_pad = matmul(R, rot_zyx(self.pad_heading, -self.slope, 0.0))
        north = rotate(R_pad, (1.0, 0.0, 0.0))
        turned = self.layout.has_heading
        true = PoseSolution(
            position=position,
            normal=rotate(R_pad, (0.0, 0.0, 1.0)),
            north=north if turned else None,
            covariance=matscale(IDENTITY, 1e-4),
            sigma_yaw=0.01 if turned else None,
            sigma_tilt=0.02,
            cost=1.0,
        )
        marker = MarkerSighting("apriltag" if turned else "whycon", None, (true,), ())
        return Sightings(self.t, self._ticks, (marker,), (self.distort(true),))

    def R_local_camera(self) -> Mat3:  # noqa: N802 - rotates camera to local
        body = rot_zyx(self.yaw, self.lean, 0.0)
        gimbal = rot_zyx(self.gimbal.yaw, self.gimbal.pitch, 0.0)
        return matmul(matmul(body, gimbal), R_GIMBAL_CAMERA)

    # ---- the world -----------------------------------------------------------------------------

    @property
    def _told_velocity(self) -> Vec3:
        return add(self.velocity, (0.0, 0.0, self.told_to_sink))

    def _move(self) -> None:
        self.pad = add(self.pad, scale(self.pad_velocity, DT))
        change = scale(sub(self.order.velocity, self._told_velocity), DT / VELOCITY_LAG_S)
        self.velocity = add(self.velocity, change)
        if self.height <= 0.0 and self.velocity[2] >= 0.0 and self.distance < 1.0:
            self.contact_t = self.t if self.contact_t is None else self.contact_t
            self.velocity = add(self.pad_velocity, (self.skids, 0.0, 0.0))
        self.position = add(self.position, scale(self.velocity, DT))
        self.yaw_rate += (self.order.yaw_rate - self.yaw_rate) * DT / YAW_LAG_S
        self.yaw = wrap(self.yaw + self.yaw_rate * DT)
        k = DT / GIMBAL_LAG_S
        self.gimbal = GimbalCommand(
            self.gimbal.yaw + k * (self._aimed.yaw - self.gimbal.yaw),
            self.gimbal.pitch + k * (self._aimed.pitch - self.gimbal.pitch),
        )

    def _telemetry(self) -> list[Input]:
        t = self.t
        messages: list[Input] = [
            LocalPosition(t, self.position, self._told_velocity),
            Attitude(
                t, 0.0, self.lean + self.pitch, self.yaw, (0.0, self.pitch_rate, self.yaw_rate)
            ),
            GimbalState(t, self.gimbal.yaw, self.gimbal.pitch, 0.0, Reference.BODY),
        ]
        if self._ticks % 2 == 0:
            messages.append(RcChannels(t, (1500,) * 10 + (self.pulse_us,)))
        beat = Heartbeat(t, self.armed, self.mode == "GUIDED", self.mode)
        if self._beat is None or replace(self._beat, t=t) != beat or t - self._beat.t >= 1.0:
            self._beat = beat
            messages.append(beat)
        if self._ticks % 8 == 0:
            down = self.contact_t is not None and t - self.contact_t > LANDED_AFTER_S
            landed = down and self.detects_landing
            messages.append(LandedState(t, Landed.ON_GROUND if landed else Landed.IN_AIR))
        return messages

    def _carry_out(self, command: Command) -> None:
        match command:
            case Setpoint():
                self._judge(command)
                self.setpoints.append((self.t, command))
                self.order = command
            case PressDown():
                assert self.contact_t is not None
                self.pressed.append(command)
                self.order = Setpoint(self.pad_velocity, 0.0)  # without thrust it stays there
            case GimbalCommand():
                self._aimed = command
            case StatusText():
                assert len(command.text) <= 50, command.text
                self.texts.append(command.text)
            case PhaseChange():
                assert command.phase is not Phase.LANDED or self.height < 0.2
                self.phases.append(command.phase)
            case Disarm():
                self.disarm_orders.append(self.t)
                self.armed = self.armed and self.contact_t is None

    def _judge(self, setpoint: Setpoint) -> None:
        """What holds for every set-point of every flight."""
        velocity, limits = setpoint.velocity, self.config.guidance.limits
        assert all(math.isfinite(v) for v in (*velocity, setpoint.yaw_rate))
        assert horizontal(velocity) <= limits.speed_mps + 1e-6
        assert -limits.climb_mps - 1e-6 <= velocity[2] <= limits.descent_mps + 1e-6
        assert abs(setpoint.yaw_rate) <= math.radians(limits.yaw_rate_deg_s) + 1e-6
        committed = self.height < 0.2
        if velocity[2] > 0.0 and not committed:
            descent = self.config.guidance.descent
            assert self.distance < descent_radius(descent, self.height)
            if self.layout.has_heading and self.height < descent.alignment_height_m:
                assert abs(self.heading_error) < math.radians(5.0)
