"""A judge, the bytes that he hears at both ends of the link, and the truth that he is given."""

from collections.abc import Sequence
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.sim.judge.bounds import RuleBounds
from hw.sim.judge.limits import SetpointLimits
from hw.sim.judge.rules import Rules
from hw.sim.judge.truth import Truth
from landerd.geometry import Vec3
from tests.hw.sim.judge.bounds import BOUNDS

DT = 0.025
GUIDED, LOITER = mavlink.COPTER_MODE_GUIDED, mavlink.COPTER_MODE_LOITER
CLIMB: Vec3 = (0.0, 0.0, -0.005)  # the gentlest order that is not one to stop
SINK: Vec3 = (0.0, 0.0, 0.01)
STOP: Vec3 = (0.0, 0.0, 0.0)
OVER_PAD = Truth(
    t=0.0,
    distance=0.0,
    height=5.0,
    heading_error=0.0,
    yaw=0.0,
    pad_velocity=(0.0, 0.0, 0.0),
    feet_down=0,
    on_plate=False,
)
ON_PAD = replace(OVER_PAD, height=0.0, feet_down=4, on_plate=True)
LOW = replace(OVER_PAD, height=0.15)

HEARTBEAT, RC = mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_RC_CHANNELS
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
POSITION = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
EXTENDED = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE


class Court:
    """Everything is in order unless a test says otherwise: the attributes may be changed.

    Attributes:
        t: the time, s.
        truth: of the world.
        armed: by the heartbeats.
        mode: likewise.
        pulse: of the gate, us.
        mute: ids of the messages that do not come.
        late_s: how long the link takes to landerd.
        rc_held_back_s: how long the autopilot keeps the channels before it sends them.
        frozen: the attitude is the same to the bit each time.
        sees: there is a marker in the pictures.
        measures: the gimbal measures.
        on_ground: the autopilot says so.
        boot_s: the autopilot was started so long before 0.
        limits: judge the changes between set-points.
    """

    def __init__(
        self, bounds: RuleBounds = BOUNDS, *, limits: bool = False, sees: bool = True
    ) -> None:
        self.t = 10.0
        self.truth = OVER_PAD
        self.armed, self.mode, self.pulse = True, GUIDED, 1100
        self.mute: set[int] = set()
        self.late_s = self.rc_held_back_s = 0.0
        self.frozen = self.on_ground = False
        self.sees, self.measures = sees, True
        self.boot_s = 100.0
        self.rules = Rules(bounds, lambda: self.truth)
        if not limits:
            self.rules._limits = _NoLimits(bounds, lambda t, rule: None)
        self._autopilot = MavlinkCodec(1, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._landerd = MavlinkCodec(1, 191)
        self.wait(0.1)
        self.pulse = 1900
        self.listen()

    @property
    def broken(self) -> list[str]:
        """All rules that were broken."""
        return list(self.rules.broken)

    # ---- what landerd hears --------------------------------------------------------------------

    def listen(self) -> None:
        """Let the autopilot and the sensors report, one control step later."""
        self.t += DT
        self.rules._truth = lambda: replace(self.truth, t=self.t)
        self.rules.on_feet(self.t, down=bool(self.truth.feet_down))
        for message in self._reports():
            if message.get_msgId() not in self.mute:
                self.hear(message)
        if self.measures:
            self.rules.on_gimbal(self.t)
        if self.sees:
            self.rules.on_sighting(self.t)

    def wait(self, seconds: float) -> None:
        """Let time go by in which landerd says nothing."""
        for _ in range(round(seconds / DT)):
            self.listen()

    def hear(self, message: Message, codec: MavlinkCodec | None = None) -> None:
        """Let a message arrive that left a while ago."""
        data = (codec or self._autopilot).encode(message)
        self.rules.from_autopilot(self.t - self.late_s, data)
        self.rules.to_landerd(self.t, data)

    def _reports(self) -> Sequence[Message]:
        ms = int(1e3 * (self.t + self.boot_s)) & 0xFFFFFFFF
        rc_ms = ms - int(1e3 * self.rc_held_back_s)
        mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        roll = 0.0 if self.frozen else 1e-3 * self.t
        channels = (*(1500,) * 10, self.pulse, *(0,) * 7)
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND if self.on_ground else 2
        return (
            mavlink.MAVLink_heartbeat_message(2, 3, mode, self.mode, 4, 3),
            mavlink.MAVLink_rc_channels_message(rc_ms, 16, *channels, 255),
            mavlink.MAVLink_attitude_message(ms, roll, *(0.0,) * 5),
            mavlink.MAVLink_local_position_ned_message(ms, roll, *(0.0,) * 5),
            mavlink.MAVLink_extended_sys_state_message(0, landed),
        )

    # ---- what landerd says ---------------------------------------------------------------------

    def send(self, message: Message) -> None:
        """Let landerd send a message."""
        self.rules.from_landerd(self.t, self._landerd.encode(message))

    def order(self, velocity: Vec3 = CLIMB, yaw_rate: float = 0.0, *, mask: int = 0x5C7) -> None:
        """Let landerd order a velocity, one control step later."""
        self.listen()
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                *(int(1e3 * self.t), 1, 1, mavlink.MAV_FRAME_LOCAL_NED, mask),
                *(0.0, 0.0, 0.0),
                *velocity,
                *(0.0, 0.0, 0.0, 0.0, yaw_rate),
            )
        )

    def fly(self, seconds: float, velocity: Vec3 = CLIMB, yaw_rate: float = 0.0) -> None:
        """Let landerd order a velocity for a while."""
        for _ in range(max(1, round(seconds / DT))):
            self.order(velocity, yaw_rate)

    def level(
        self,
        seconds: float = DT,
        *,
        q: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        thrust: float = 0.0,
        mask: int = 7,
    ) -> None:
        """Let landerd order to be level and without thrust for a while."""
        for _ in range(max(1, round(seconds / DT))):
            self.listen()
            self.send(
                mavlink.MAVLink_set_attitude_target_message(
                    int(1e3 * self.t), 1, 1, mask, q, 0.0, 0.0, 0.0, thrust
                )
            )

    def command(self, command: int, *params: float) -> None:
        """Let landerd send a COMMAND_LONG."""
        values = (*params, *(0.0,) * (7 - len(params)))
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *values))

    def disarm(self) -> None:
        """Let landerd order to disarm."""
        self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)

    def say(self, text: str) -> None:
        """Let landerd tell the pilot something."""
        self.send(mavlink.MAVLink_statustext_message(4, text.encode()))


class _NoLimits(SetpointLimits):
    """Replaces the judge of the limits, which has tests of its own: orders here jump."""

    def check(self, *args: object, **more: object) -> None:
        pass
