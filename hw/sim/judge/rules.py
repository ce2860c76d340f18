"""The judge: checks the safety rules at every message from what is on the wire and from truth.

It never asks landerd's opinion. A sighting is, for it, a marker that was really in a frame that was
delivered; what the pilot and the autopilot said is what went over the link to landerd, and it is as
old as truth says. Rule numbers are those of docs/safety.md; the rules are in hw.sim.judge.table.
"""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.sim.judge import allowed
from hw.sim.judge.bounds import RuleBounds
from hw.sim.judge.evidence import BOUNCE_S, Evidence, Order
from hw.sim.judge.limits import SetpointLimits
from hw.sim.judge.table import ORDER_RULES, TIME_RULES
from hw.sim.judge.truth import Truth
from hw.sim.judge.wire import GIMBAL_REPORTS, Departures, Wire, frames
from landerd.geometry import Vec3, rot_z, rotate

_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)
_ASKS = {
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
    mavlink.MAVLINK_MSG_ID_PARAM_SET,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    mavlink.MAVLINK_MSG_ID_COMMAND_INT,
}
_ANSWERS = (mavlink.MAVLINK_MSG_ID_PARAM_VALUE, mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
_ANSWERS_S = 10.0  # the list of all parameters takes so long
_LANDED_NEWS = "landed and disarmed"
_MOST = 1e6  # m, m/s or rad: beyond, and not finite, is no measurement


class Rules:
    """Collects what was broken.

    Attributes:
        broken: each rule once with the time it was first broken.
        disarm_orders: how many there were.
        on_order: told of each order to fly, after the rules.
        on_text: told of what the pilot is told, with the time, s.
    """

    def __init__(self, bounds: RuleBounds, truth: Callable[[], Truth]) -> None:
        self.broken: dict[str, float] = {}
        self.disarm_orders = 0
        self.on_order: list[Callable[[Order], None]] = []
        self.on_text: list[Callable[[float, str], None]] = []
        self._b = bounds
        self._truth = truth
        self._evidence = Evidence(bounds)
        self._limits = SetpointLimits(bounds, self._break)
        self._wire = Wire()
        self._departures = Departures()
        self._checked_t = -math.inf

    @property
    def guided(self) -> bool:
        """Whether the last heartbeat said armed and GUIDED."""
        return self._evidence.armed and self._evidence.guided

    def may_fly(self, t: float) -> bool:
        """Tell whether landerd may fly at a time, s, on data young enough for it."""
        return self._evidence.granted(t) and not self._evidence.stale_at(t, self._b.sighting_s)

    @property
    def in_another_mode(self) -> bool:
        """Whether it said armed and another mode."""
        return self._evidence.armed and not self._evidence.guided

    @property
    def texts(self) -> list[tuple[float, str]]:
        """What the pilot was told, with the times."""
        return self._evidence.texts

    def on_mounted(self, hidden_heading: float) -> None:
        """Take by how much the pad's heading shows too large through the mounting, rad."""
        self._evidence.hidden_heading = hidden_heading

    def on_death(self, t: float) -> None:
        """Note that landerd's process is killed: its duties end, and its successor is latched."""
        self._evidence.on_death(t)

    # ---- what the judge sees -------------------------------------------------------------------

    def on_feet(self, t: float, *, down: bool) -> None:
        """Take a step of the world: whether a foot is down at t."""
        self._evidence.on_feet(t, down=down)
        # Here too, since nothing arrives over a dead link.
        self._check_time(t)

    def on_sighting(self, exposure_t: float) -> None:
        """Take a delivered frame with a marker really in it."""
        self._evidence.sighting_t = max(self._evidence.sighting_t, exposure_t)

    def on_gimbal(self, measured_t: float) -> None:
        """Take gimbal angles that were delivered, measured by the world's gimbal at a time."""
        self._evidence.on_measured("gimbal", measured_t, measured_t)

    def from_autopilot(self, t: float, data: bytes) -> None:
        """Take bytes that leave the autopilot for landerd."""
        self._departures.sent(t, data)

    def to_landerd(self, t: float, data: bytes) -> None:
        """Take bytes that arrive at landerd."""
        self._check_time(t)  # by what was known before they came
        for message in self._wire.messages(data):
            system = message.get_srcSystem()
            if system == self._b.system_id:
                if message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
                    left_t = self._departures.left(bytes(message.get_msgbuf()), t)
                    self._of_autopilot(t, left_t, message)
            elif system in self._b.ground_stations and message.get_msgId() in _ASKS:
                self._evidence.asked_t = t

    def _of_autopilot(self, t: float, left_t: float, m: mavlink.MAVLink_message) -> None:
        evidence, kind = self._evidence, m.get_msgId()
        if "time_boot_ms" in m.fieldnames:
            if not evidence.on_boot_time(t, 1e-3 * m.time_boot_ms):
                return  # landerd must not fly on it
            left_t -= evidence.held_back_s(kind, 1e-3 * m.time_boot_ms)
        if kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            evidence.on_heartbeat(t, m)
        elif kind == mavlink.MAVLINK_MSG_ID_RC_CHANNELS:
            evidence.on_rc(t, left_t, m)
        elif kind == mavlink.MAVLINK_MSG_ID_ATTITUDE:
            angles = (m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed)
            _measured(evidence, "attitude", left_t, angles)
        elif kind == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            _measured(evidence, "position", left_t, (m.x, m.y, m.z, m.vx, m.vy, m.vz))
        elif kind in GIMBAL_REPORTS:
            evidence.on_measured("gimbal", left_t, left_t)
        elif kind == mavlink.MAVLINK_MSG_ID_TIMESYNC and m.tc1:
            evidence.on_boot_time(t, 1e-9 * m.tc1, is_answer=True)
        elif kind == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            on_ground = m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
            evidence.on_landed_state(t, on_ground=on_ground)

    def from_landerd(self, t: float, data: bytes) -> None:
        """Take bytes that landerd sends."""
        for kind, _ in frames(data):
            if kind not in allowed.MESSAGES:
                self._break(t, f"1: sent {allowed.message_name(kind)}")
        for message in self._wire.messages(data):
            kind = message.get_msgId()
            if kind == mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
                self._on_setpoint(t, message)
            elif kind == mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
                sound = allowed.is_level_target(message)
                truth = self._truth()
                self._check_order(Order(t, (0.0, 0.0, 0.0), 0.0, truth, level=True, sound=sound))
            elif kind == mavlink.MAVLINK_MSG_ID_COMMAND_LONG:
                self._on_command(t, message)
            elif kind == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                self._on_text(t, message.text)
            elif kind in _ANSWERS and t - self._evidence.asked_t > _ANSWERS_S:
                self._break(t, "7: an answer that no configured ground station asked for")

    # ---- landerd's orders ----------------------------------------------------------------------

    def _on_setpoint(self, t: float, m: mavlink.MAVLink_message) -> None:
        if not allowed.is_velocity_target(m):
            self._break(t, "1: sent a target other than a velocity with a yaw rate")
        velocity: Vec3 = (m.vx, m.vy, m.vz)
        if not all(math.isfinite(x) for x in (*velocity, m.yaw_rate)):
            self._break(t, "3: a set-point is not finite")
            return
        truth = self._truth()
        in_body_frame = m.coordinate_frame in _BODY_FRAMES
        if in_body_frame:
            velocity = rotate(rot_z(truth.yaw), velocity)
        self._check_order(Order(t, velocity, m.yaw_rate, truth, in_body_frame=in_body_frame))

    def _check_order(self, order: Order) -> None:
        evidence = self._evidence
        evidence.note(order)
        for text, is_broken in ORDER_RULES:
            if is_broken(evidence, order, self._b):
                self._break(order.t, text)
        if order.level:
            self._limits.levelled()
        else:
            waves_off = evidence.waves_off(order)
            self._limits.check(
                order.t,
                order.velocity,
                order.yaw_rate,
                waves_off=waves_off,
                flown=order.truth.velocity,
                in_body_frame=order.in_body_frame,
            )
        evidence.last_order_t = order.t
        for tell in self.on_order:
            tell(order)

    def _on_command(self, t: float, message: mavlink.MAVLink_message) -> None:
        if not allowed.command_is_allowed(message, self._b):
            self._break(t, f"1: sent command {message.command}")
        if message.command != mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            return
        evidence = self._evidence
        self.disarm_orders += 1
        evidence.disarm_t = t
        if message.param1 != 0.0 or message.param2 != 0.0:
            self._break(t, "4: arming, or a forced disarm")
        if evidence.on_ground_t is None:
            self._break(t, "4: disarm before the autopilot said ON_GROUND")
        if not self._truth().feet_down and t - evidence.touched_t > BOUNCE_S:
            self._break(t, "4: disarm while no foot is down")
        lost_s = t - evidence.authority_lost_t
        if not (evidence.armed and evidence.guided) and lost_s > self._b.tick_s:
            self._break(t, "1a: a disarm order while not armed or not GUIDED")

    def _on_text(self, t: float, text: str) -> None:
        self._evidence.tell(t, text)
        for tell in self.on_text:
            tell(t, text)
        if _LANDED_NEWS in text and not self._truth().on_plate:
            self._break(t, "6: said to have landed, and does not stand on the pad")

    # ---- what must come in time ----------------------------------------------------------------

    def _check_time(self, t: float) -> None:
        if t < self._checked_t:  # the world lags by a step
            return
        self._checked_t = t
        evidence, b = self._evidence, self._b
        release_s = b.release_s - b.early_s
        is_over = t >= evidence.closed_t + release_s
        # The stop may have begun earlier for another reason, such as stale RC.
        since, last_t = evidence.stops_since, evidence.last_order_t
        if t >= evidence.closed_t and since is not None and last_t is not None:
            is_over = is_over or last_t - since >= release_s
        if not (evidence.armed and evidence.guided) or is_over:
            evidence.free_t = t
        # Released while it stood there, it is silent until it sees the pad (rule 1c).
        if not evidence.granted(t) or last_t is None or t - last_t > b.release_s:
            evidence.barred_t = t
        for text, is_broken in TIME_RULES:
            if is_broken(evidence, t, b):
                self._break(t, text)

    def _break(self, t: float, rule: str) -> None:
        self.broken.setdefault(rule, t)


def _measured(evidence: Evidence, what: str, t: float, numbers: tuple[float, ...]) -> None:
    """Take a report of time t (s), unless its numbers are impossible."""
    if all(abs(x) < _MOST for x in numbers):
        evidence.on_measured(what, t, numbers)
