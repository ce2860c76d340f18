"""The judge: checks the safety rules at every message from what is on the wire and from truth.

It never asks landerd's opinion. A sighting is, for it, a marker that was really in a frame that was
delivered; what the pilot and the autopilot said is what went over the link to landerd. Rule numbers
are those of docs/safety.md.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.sim.judge.bounds import ZERO, RuleBounds
from hw.sim.judge.limits import SetpointLimits
from hw.sim.judge.wire import Wire
from landerd.geometry import Vec3, horizontal, rot_z, rotate

_CONTACT_LATE_S = 0.6  # truth's first contact to the time landerd must behave as on the pad
_LEVEL_AFTER_S = 0.5  # for so long the vehicle goes with the pad before it may stand level
_BOUNCE_S = 0.2  # feet up for longer than this end a contact
_HOVER_MPS = 0.02  # an order of less, horizontally, is one to hover
_TOLD_S = 1.0  # before an abort or after it the pilot is told of it
_PHASE_NEWS = ("approach:", "yaw correction:", "descent:", "landed:")
_LOSS_NEWS = ("not in sight", "stale", "no pictures")
_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)
_ATTITUDE_AND_THRUST = 7  # type_mask of SET_ATTITUDE_TARGET: the body's rates are ignored


@dataclass(frozen=True)
class Truth:
    """What the rules need of the world, local NED."""

    t: float
    distance: float  # centre of the feet to the landing point, horizontal, m
    height: float  # of the feet's centre over the landing point, m
    heading_error: float  # pad minus vehicle, rad
    yaw: float  # rad
    pad_velocity: Vec3
    feet_down: int


class Rules:
    """Collects what was broken; `broken` has each rule once with the time it was first broken."""

    def __init__(self, bounds: RuleBounds, truth: Callable[[], Truth]) -> None:
        self._b = bounds
        self._truth = truth
        self._wire = Wire()
        self._limits = SetpointLimits(bounds, self._break)
        self.broken: dict[str, float] = {}
        self.texts: list[tuple[float, str]] = []
        self.disarm_orders = 0
        self._armed = self._guided = False
        self._beat_t = -math.inf
        self._authority_lost_t = 0.0  # since when landerd must be silent
        self._latched = True
        self._gate_closed_t: float | None = 0.0
        self._rc_t = -math.inf
        self._attitude_t = self._position_t = self._gimbal_t = -math.inf
        self._sighting_t = -math.inf  # exposure of the last delivered frame with a marker in it
        self._first_sighting = False
        self._flown_t: float | None = None  # last set-point under granted authority
        self._contact = False  # a foot was down, and the vehicle has not climbed away since
        self._touched_t = -math.inf  # when a foot was last seen down,
        self._touching_since = 0.0  # and since when but for bounces
        self._on_ground_t: float | None = None
        self._lost_since: float | None = None
        self._free_t = 0.0  # last time landerd was not bound to stream set-points
        self._handed_back_t = math.inf
        self._boot_ms = 0

    # ---- what the judge sees -------------------------------------------------------------------

    def on_sighting(self, exposure_t: float) -> None:
        """A frame with a marker really in it was delivered."""
        self._sighting_t = max(self._sighting_t, exposure_t)
        self._first_sighting = True

    def on_gimbal(self, t: float) -> None:
        """Gimbal angles measured at t were delivered."""
        self._gimbal_t = t

    def to_landerd(self, t: float, data: bytes) -> None:
        """Bytes of the autopilot arrive at landerd."""
        self._check_stream(t)
        for message in self._wire.messages(data):
            kind = message.get_msgId()
            if message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
                continue  # the autopilot routes the ground station's messages too
            if kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self._on_heartbeat(t, message)
            elif kind == mavlink.MAVLINK_MSG_ID_RC_CHANNELS:
                self._on_rc(t, message)
            elif kind == mavlink.MAVLINK_MSG_ID_ATTITUDE:
                self._attitude_t = t
                if message.time_boot_ms + 1000 < self._boot_ms:
                    self._latched = True
                self._boot_ms = message.time_boot_ms
            elif kind == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self._position_t = t
            elif (
                kind == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
                and message.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
                and self._on_ground_t is None
            ):
                self._on_ground_t = t

    def from_landerd(self, t: float, data: bytes) -> None:
        """Bytes of landerd leave for the autopilot."""
        for message in self._wire.messages(data):
            kind = message.get_msgId()
            if kind == mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
                self._on_setpoint(t, message)
            elif kind == mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
                self._on_attitude(t, message)
            elif kind == mavlink.MAVLINK_MSG_ID_COMMAND_LONG:
                self._on_command(t, message)
            elif kind == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                self.texts.append((t, message.text))
                if "take over" in message.text:
                    self._handed_back_t = min(self._handed_back_t, t)

    # ---- the link to landerd -------------------------------------------------------------------

    def _on_heartbeat(self, t: float, message: mavlink.MAVLink_message) -> None:
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        guided = message.custom_mode == mavlink.COPTER_MODE_GUIDED
        had = self._armed and self._guided
        if (self._armed and not armed) or (self._guided and not guided):
            self._latched = True
        if had and not (armed and guided):
            self._authority_lost_t = t
        if self._armed and not armed:
            # The next flight is judged afresh.
            self._contact, self._on_ground_t = False, None
        self._armed, self._guided, self._beat_t = armed, guided, t

    def _on_rc(self, t: float, message: mavlink.MAVLink_message) -> None:
        pulse = getattr(message, f"chan{self._b.gate_channel}_raw")
        present = self._b.gate_channel <= message.chancount and pulse not in (0, 65535)
        high = present and pulse > self._b.gate_threshold_us
        if present and not high:
            self._latched = False
            self._handed_back_t = math.inf
        if high:
            self._gate_closed_t = None
        elif self._gate_closed_t is None:
            self._gate_closed_t = t
        self._rc_t = t

    # ---- landerd's orders ----------------------------------------------------------------------

    def _on_setpoint(self, t: float, message: mavlink.MAVLink_message) -> None:
        truth = self._truth()
        velocity: Vec3 = (message.vx, message.vy, message.vz)
        yaw_rate = message.yaw_rate
        if not all(math.isfinite(x) for x in (*velocity, yaw_rate)):
            self._break(t, "3: a set-point is not finite")
            return
        if message.coordinate_frame in _BODY_FRAMES:
            velocity = rotate(rot_z(truth.yaw), velocity)
        zero = math.hypot(*velocity) < ZERO and abs(yaw_rate) < ZERO
        self._note_contact(t, truth)
        tick = 1.05 * self._b.control_period_s
        self._who_flies(t, zero, tick)
        if not zero and not self._contact:
            self._never_blind(t, velocity, yaw_rate, truth, tick)
        self._limits.check(t, velocity, yaw_rate)
        if truth.feet_down:
            self._after_contact(t, velocity)

    def _note_contact(self, t: float, truth: Truth) -> None:
        """Note what the feet touch."""
        if truth.feet_down:
            self._contact = True
            if t - self._touched_t > _BOUNCE_S:
                self._touching_since = t
            self._touched_t = t
        elif truth.height > self._b.commit_height_m:
            self._contact = False

    def _who_flies(self, t: float, zero: bool, tick: float) -> None:
        b = self._b
        granted = self._armed and self._guided and t - self._beat_t <= b.heartbeat_s + tick
        if not granted and t - self._authority_lost_t > tick:
            self._break(t, "1a: a set-point while not armed, not GUIDED or without heartbeat")
        closed_t = self._closed_t(t)
        if t - closed_t > tick:
            if not zero:
                self._break(t, "1b: a set-point other than zero with the gate low or stale")
            elif t - closed_t > b.release_s + 2 * tick + 0.05:
                self._break(t, "1b: set-points after the release time")
        elif t < closed_t:
            self._flown_t = t
            # What was on its way when authority was lost is judged by rule 1a.
            if self._latched and not zero and t - self._authority_lost_t > tick:
                self._break(t, "1: a set-point before the gate was seen low again")
        if not self._first_sighting:
            self._break(t, "1c: a set-point before the first sighting")

    def _never_blind(
        self, t: float, velocity: Vec3, yaw_rate: float, truth: Truth, tick: float
    ) -> None:
        b = self._b
        age = t - self._sighting_t
        committed = truth.height < b.commit_height_m
        oldest = b.blind_commit_s if committed else b.sighting_s
        if velocity[2] > max(0.0, truth.pad_velocity[2]) + ZERO:
            if age > oldest:
                self._break(t, "2: a downward set-point without a young sighting")
            if not committed:
                self._descending(t, truth)
        stale = (
            t - self._attitude_t > b.attitude_s + tick
            or t - self._position_t > b.position_s + tick
            or t - self._gimbal_t > b.gimbal_s + b.sighting_s + tick
        )
        if stale or age > oldest + tick:
            self._flying_blind(t, velocity, yaw_rate, tick)
        else:
            self._lost_since = None

    def _descending(self, t: float, truth: Truth) -> None:
        b = self._b
        if truth.distance > b.k1_m * math.exp(b.k2_per_m * truth.height):
            self._break(t, "2: a downward set-point outside the descent region")
        if (
            b.has_heading
            and truth.height < b.alignment_height_m
            and abs(truth.heading_error) > b.heading
        ):
            self._break(t, "2: a downward set-point with the heading off")

    def _flying_blind(self, t: float, velocity: Vec3, yaw_rate: float, tick: float) -> None:
        """Rule 1d and 5: slow down to a hover, then only hold, climb or turn (not ordered here)."""
        if self._lost_since is None:
            self._lost_since = t
        b = self._b
        if t - self._lost_since > tick and abs(yaw_rate) > ZERO:
            self._break(t, "1d: turning while the pad is out of sight")
        if velocity[2] > ZERO:
            self._break(t, "1d: descending while the pad is out of sight or data are stale")
        # Full braking, and the last of it fading out with the jerk limit.
        braking_s = b.speed_mps / b.acceleration_mps2 + 5.0 * b.acceleration_mps2 / b.jerk_mps3
        if horizontal(velocity) > _HOVER_MPS and t - self._lost_since > braking_s + tick:
            self._break(t, "1d: not hovering while the pad is out of sight or data are stale")
        # Nothing new is to be told of a marker that came in sight and went without being taken.
        said = self._last_news_is_bad() or any(
            at >= self._lost_since - _TOLD_S for at, _ in self.texts
        )
        if t - self._lost_since > _TOLD_S and not said:
            self._break(t, "6: an abort that the pilot was not told of")

    def _last_news_is_bad(self) -> bool:
        """Tell whether the pilot was last told that the pad is lost, not of a phase."""
        for _, text in reversed(self.texts):
            if any(words in text for words in _PHASE_NEWS):
                return False
            if any(words in text for words in _LOSS_NEWS):
                return True
        return False

    def _after_contact(self, t: float, velocity: Vec3) -> None:
        waited = t - self._touching_since
        pressed = self._on_ground_t is None and _CONTACT_LATE_S < waited < self._b.settle_s
        is_open = self._gate_closed_t is None
        granted = is_open and self._armed and self._guided and not self._latched
        if pressed and granted and velocity[2] <= ZERO:
            self._break(t, "4: no descent ordered after contact")

    def _on_attitude(self, t: float, message: mavlink.MAVLink_message) -> None:
        """In place of a set-point, level and without thrust, on the pad only."""
        truth = self._truth()
        self._note_contact(t, truth)
        self._who_flies(t, False, 1.05 * self._b.control_period_s)
        level = math.hypot(message.q[1], message.q[2]) < ZERO
        if not (level and message.thrust == 0.0 and message.type_mask == _ATTITUDE_AND_THRUST):
            self._break(t, "4: an attitude ordered other than level and without thrust")
        if t - self._touched_t > _BOUNCE_S:
            self._break(t, "4: level and without thrust while no foot is down")
        elif t - self._touching_since < _LEVEL_AFTER_S:
            self._break(t, "4: did not go with the pad after contact")
        self._limits.levelled(t)

    def _on_command(self, t: float, message: mavlink.MAVLink_message) -> None:
        if message.command != mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            return
        self.disarm_orders += 1
        if message.param1 != 0.0 or message.param2 != 0.0:
            self._break(t, "4: arming, or a forced disarm")
        if self._on_ground_t is None:
            self._break(t, "4: disarm before the autopilot said ON_GROUND")

    def _closed_t(self, t: float) -> float:
        """Since when the gate has been closed: by the switch, by stale RC, by handing back."""
        closed = self._handed_back_t
        if self._gate_closed_t is not None:
            closed = min(closed, self._gate_closed_t)
        if t - self._rc_t > self._b.rc_s:
            closed = min(closed, self._rc_t + self._b.rc_s)
        return closed

    def _check_stream(self, t: float) -> None:
        """Rules 1b, 1d and 3: while landerd must stream, the gap between set-points is bounded."""
        last_t = self._limits.last_t
        if last_t is None or self._flown_t is None:
            return
        b = self._b
        granted = self._armed and self._guided and t - self._beat_t <= b.heartbeat_s
        open_or_releasing = t < self._closed_t(t) + b.release_s - b.control_period_s
        if not granted or self._latched or not open_or_releasing:
            self._free_t = t
        elif self._flown_t > self._free_t and t - last_t > b.stream_s + 1e-6:
            self._break(t, "3: set-points less often than 20 Hz")

    def _break(self, t: float, rule: str) -> None:
        self.broken.setdefault(rule, t)
