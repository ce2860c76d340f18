"""Who flies: arming, GUIDED, the pilot's switch, and the latch (design rule 1; thesis 2.4.5)."""

import math
from dataclasses import replace
from enum import Enum

from landerd.config.models import FreshnessSection, RcSection
from landerd.guidance import pilot_texts
from landerd.messages import ClockSync, Heartbeat, RcChannels


class Authority(Enum):
    """What landerd may do now."""

    SILENT = "silent"  # not armed or not GUIDED: nothing may be sent
    RELEASED = "released"  # the pilot's gate is closed, the latch is set, or nothing is known
    GRANTED = "granted"  # landerd may fly


class Gate:
    """Decides from heartbeat and RC whether landerd may fly, and says why not.

    Losing GUIDED, disarming and a restart (ours or the autopilot's) latch: the pilot must have
    the switch low once before landerd flies again. Data that are merely stale do not latch.
    """

    def __init__(self, rc: RcSection, freshness: FreshnessSection) -> None:
        self._rc: RcSection | None = None
        self.configure(rc)
        self._freshness = freshness
        self._heartbeat: Heartbeat | None = None
        self._rc_t = -math.inf
        self._clock_s = 0.0
        self._ending = False

    def configure(self, rc: RcSection) -> None:
        """Take the switch's channel and thresholds; a changed switch must be seen low first."""
        if rc != self._rc:
            self._rc = rc
            self._channel = rc.gate_channel
            self._threshold_us = rc.gate_threshold_us
            self._land_threshold_us = rc.land_threshold_us
            self._pulse_us = 0
            self._latched = True  # as when just started

    @property
    def disarmed(self) -> bool:
        """Whether the last heartbeat said disarmed; False while there was none."""
        return self._heartbeat is not None and not self._heartbeat.armed

    @property
    def asks_to_hold(self) -> bool:
        """Whether the switch is in its middle: to hold over the marker and not to land yet."""
        return self._threshold_us < self._pulse_us <= self._land_threshold_us

    @property
    def with_pilot(self) -> bool:
        """Whether the pilot took the vehicle, or has not given it yet; not so for stale data."""
        return self._latched or 0 < self._pulse_us <= self._threshold_us

    def on_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Take the autopilot's heartbeat; one older than the last is dropped."""
        last = self._heartbeat
        if last is not None and heartbeat.t < last.t:
            return
        if last is not None and (
            (last.guided and not heartbeat.guided) or (last.armed and not heartbeat.armed)
        ):
            self._latched = True
        self._heartbeat = heartbeat

    def on_rc(self, rc: RcChannels) -> None:
        """Take the receiver's channels; a pulse of 0 is no signal and neither low nor high."""
        if rc.t < self._rc_t:
            return
        i = self._channel - 1
        self._rc_t = rc.t
        self._pulse_us = rc.channels_us[i] if i < len(rc.channels_us) else 0
        if 0 < self._pulse_us <= self._threshold_us:
            self._latched = False

    def on_clock(self, clock: ClockSync) -> None:
        """Take the uncertainty of the autopilot's clock: its data may be older by that much."""
        self._clock_s = clock.uncertainty_s

    def on_restart(self) -> None:
        """Forget what the autopilot reported before it restarted, and latch."""
        if self._heartbeat is not None:
            self._heartbeat = replace(self._heartbeat, t=-math.inf)
        self._rc_t = -math.inf
        self._latched = True

    def latch(self) -> None:
        """Ask for the switch to be low once before landerd flies again."""
        self._latched = True

    def end(self) -> None:
        """Never let landerd fly again: its process is about to end, whatever the switch does."""
        self._ending = True

    def authority(self, now: float) -> tuple[Authority, str]:
        """Return what landerd may do at time now, and why not more, in plain words."""
        beat = self._heartbeat
        if beat is None or now - beat.t + self._clock_s > self._freshness.heartbeat_s:
            # An autopilot that was heard before may fly on with the last velocity: stop it first.
            silent = Authority.SILENT if beat is None else Authority.RELEASED
            return silent, pilot_texts.NO_HEARTBEAT
        if not beat.armed:
            return Authority.SILENT, pilot_texts.NOT_ARMED
        if not beat.guided:
            return Authority.SILENT, pilot_texts.NOT_GUIDED.format(mode=beat.mode)
        if self._ending:
            return Authority.RELEASED, pilot_texts.TOLD_TO_STOP
        if now - self._rc_t + self._clock_s > self._freshness.rc_s:
            return Authority.RELEASED, pilot_texts.RC_STALE
        if self._pulse_us == 0:
            return Authority.RELEASED, pilot_texts.RC_NO_SIGNAL.format(channel=self._channel)
        if self._pulse_us <= self._threshold_us:
            return Authority.RELEASED, pilot_texts.RC_LOW.format(channel=self._channel)
        if self._latched:
            return Authority.RELEASED, pilot_texts.RC_LATCHED.format(channel=self._channel)
        return Authority.GRANTED, pilot_texts.GRANTED
