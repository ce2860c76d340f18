import pytest

from landerd.config.models import FreshnessSection, RcSection
from landerd.guidance.gate import Authority, Gate
from landerd.messages import ClockSync, Heartbeat, RcChannels

LOW, HIGH = 1100, 1900


class Pilot:
    """A gate and the messages it gets; the time goes on with each."""

    def __init__(self, *, channel: int = 11) -> None:
        self.gate = Gate(RcSection(gate_channel=channel), FreshnessSection())
        self.t = 100.0

    def beat(self, *, armed: bool = True, mode: str = "GUIDED") -> "Pilot":
        self.t += 0.01
        self.gate.on_heartbeat(Heartbeat(self.t, armed, mode == "GUIDED", mode))
        return self

    def switch(self, pulse_us: int) -> "Pilot":
        self.t += 0.01
        self.gate.on_rc(RcChannels(self.t, (1500,) * 10 + (pulse_us,) + (0,) * 7))
        return self

    def granted(self) -> "Pilot":
        self.beat().switch(LOW).switch(HIGH)
        assert self.may() is Authority.GRANTED
        return self

    def may(self) -> Authority:
        return self.gate.authority(self.t)[0]

    @property
    def why(self) -> str:
        return self.gate.authority(self.t)[1]


def test_without_a_heartbeat_it_is_silent() -> None:
    assert Pilot().switch(LOW).switch(HIGH).may() is Authority.SILENT


def test_the_switch_low_then_high_in_guided_and_armed_grants() -> None:
    pilot = Pilot().beat().switch(LOW)
    assert pilot.may() is Authority.RELEASED
    assert pilot.switch(HIGH).may() is Authority.GRANTED


def test_a_switch_that_was_high_all_the_time_grants_nothing_after_a_start() -> None:
    pilot = Pilot().beat().switch(HIGH).switch(HIGH)
    assert pilot.may() is Authority.RELEASED
    assert "low" in pilot.why
    assert pilot.switch(LOW).switch(HIGH).may() is Authority.GRANTED


@pytest.mark.parametrize(
    ("armed", "mode", "said"),
    [(False, "GUIDED", "armed"), (True, "LOITER", "LOITER"), (True, "LAND", "LAND")],
)
def test_not_armed_or_another_mode_is_silent_and_says_which(
    armed: bool, mode: str, said: str
) -> None:
    pilot = Pilot().granted().beat(armed=armed, mode=mode)
    assert pilot.may() is Authority.SILENT
    assert said in pilot.why


@pytest.mark.parametrize(("armed", "mode"), [(False, "GUIDED"), (True, "LOITER")])
def test_after_disarming_or_leaving_guided_the_switch_must_be_low_first(
    armed: bool, mode: str
) -> None:
    pilot = Pilot().granted().beat(armed=armed, mode=mode).beat()
    assert pilot.switch(HIGH).may() is Authority.RELEASED
    assert pilot.switch(LOW).may() is Authority.RELEASED
    assert pilot.switch(HIGH).may() is Authority.GRANTED


def test_after_a_restart_of_the_autopilot_the_switch_must_be_low_first() -> None:
    pilot = Pilot().granted()
    pilot.gate.on_restart()
    assert pilot.may() is Authority.RELEASED
    assert pilot.beat().switch(HIGH).may() is Authority.RELEASED
    assert pilot.switch(LOW).switch(HIGH).may() is Authority.GRANTED


def test_latch_requires_the_switch_low_before_landerd_may_fly() -> None:
    pilot = Pilot().granted()
    pilot.gate.latch()
    assert pilot.switch(HIGH).may() is Authority.RELEASED
    assert pilot.switch(LOW).switch(HIGH).may() is Authority.GRANTED


def test_a_switch_already_low_when_guided_is_lost_is_seen_low_again() -> None:
    pilot = Pilot().granted().beat(mode="LOITER")
    assert pilot.switch(LOW).beat().switch(HIGH).may() is Authority.GRANTED


def test_a_switch_put_high_before_guided_starts_a_landing_with_guided() -> None:
    pilot = Pilot().beat(mode="LOITER").switch(LOW).switch(HIGH)
    assert pilot.may() is Authority.SILENT
    assert pilot.beat().may() is Authority.GRANTED


def test_a_stale_heartbeat_releases_but_the_switch_need_not_be_low_afterwards() -> None:
    pilot = Pilot().granted()
    pilot.t += 2.9
    pilot.switch(HIGH)
    assert pilot.may() is Authority.GRANTED
    pilot.t += 0.2
    pilot.switch(HIGH)
    assert pilot.may() is Authority.RELEASED
    assert pilot.beat().may() is Authority.GRANTED


def test_stale_rc_releases_but_the_switch_need_not_be_low_afterwards() -> None:
    pilot = Pilot().granted()
    pilot.t += 0.45
    assert pilot.may() is Authority.GRANTED
    pilot.t += 0.1
    assert pilot.may() is Authority.RELEASED
    assert pilot.switch(HIGH).may() is Authority.GRANTED


def test_half_the_round_trip_counts_as_age() -> None:
    pilot = Pilot().granted()
    pilot.gate.on_clock(ClockSync(pilot.t, 0.2))
    pilot.t += 0.29
    assert pilot.may() is Authority.GRANTED
    pilot.t += 0.02
    assert pilot.may() is Authority.RELEASED


@pytest.mark.parametrize(
    ("pulse_us", "granted"), [(1500, False), (1501, True), (900, False), (2100, True)]
)
def test_the_gate_opens_above_1500_us(pulse_us: int, granted: bool) -> None:
    pilot = Pilot().granted().switch(pulse_us)
    assert (pilot.may() is Authority.GRANTED) is granted


def test_no_signal_closes_the_gate_but_is_not_the_switch_seen_low() -> None:
    pilot = Pilot().granted().switch(0)
    assert pilot.may() is Authority.RELEASED
    assert pilot.switch(HIGH).may() is Authority.GRANTED
    started = Pilot().beat().switch(0).switch(HIGH)
    assert started.may() is Authority.RELEASED


def test_a_receiver_without_the_channel_grants_nothing() -> None:
    pilot = Pilot(channel=18).beat()
    pilot.gate.on_rc(RcChannels(pilot.t, (HIGH,) * 16))
    assert pilot.may() is Authority.RELEASED


def test_the_configured_channel_is_the_one_that_counts() -> None:
    pilot = Pilot(channel=7).beat()
    for pulse in (LOW, HIGH):
        pilot.t += 0.01
        channels = [LOW] * 18
        channels[6] = pulse
        pilot.gate.on_rc(RcChannels(pilot.t, tuple(channels)))
    assert pilot.may() is Authority.GRANTED


@pytest.mark.parametrize(
    ("pulse_us", "may", "holds"),
    [
        (1300, Authority.RELEASED, False),
        (1301, Authority.GRANTED, True),
        (1700, Authority.GRANTED, True),
        (1701, Authority.GRANTED, False),
    ],
)
def test_between_its_ends_a_switch_of_three_positions_asks_to_hold(
    pulse_us: int, may: Authority, holds: bool
) -> None:
    pilot = Pilot()
    pilot.gate.configure(RcSection(gate_threshold_us=1300, land_threshold_us=1700))
    pilot.granted().switch(pulse_us)
    assert pilot.may() is may
    assert pilot.gate.asks_to_hold is holds


@pytest.mark.parametrize("pulse_us", [1400, 1501, 1600, 2000])
def test_a_switch_of_two_positions_never_asks_to_hold(pulse_us: int) -> None:
    assert not Pilot().granted().switch(pulse_us).gate.asks_to_hold


def test_messages_older_than_the_last_are_dropped() -> None:
    pilot = Pilot().granted()
    pilot.gate.on_heartbeat(Heartbeat(pilot.t - 1.0, False, False, "LOITER"))
    pilot.gate.on_rc(RcChannels(pilot.t - 1.0, (LOW,) * 18))
    assert pilot.may() is Authority.GRANTED


def test_half_the_round_trip_counts_as_age_of_the_heartbeat() -> None:
    pilot = Pilot().granted()
    pilot.gate.on_clock(ClockSync(pilot.t, 0.2))
    pilot.t += 2.7
    assert pilot.switch(HIGH).may() is Authority.GRANTED
    pilot.t += 0.2
    assert pilot.switch(HIGH).may() is Authority.RELEASED
    assert "heartbeat" in pilot.why
