"""The pilot's radio as the autopilot's receiver sees it."""

import math

_CHANNELS = 18  # number of channels in RC_CHANNELS
_OVERRIDE_TIME_S = 3.0  # RC_OVERRIDE_TIME
_THROTTLE_LOW_US = 1100


class PilotRadio:
    """Channels set by a pilot, and a ground station's overrides on top of them.

    Sticks are centred except the throttle, which is low as in ArduPilot's SITL; switches are off.

    Attributes:
        lost: the receiver has no signal and holds the last pulses.
        overridden_t: when the last override came, s; any override counts as a radio signal.
    """

    def __init__(self, count: int = 16) -> None:
        """Make one; count: of the receiver's channels; those beyond have overrides, or 0."""
        self.lost = False
        self.overridden_t = -math.inf
        self._pulses = [1500, 1500, 1000, 1500] + [1000] * (count - 4) + [0] * (_CHANNELS - count)
        self._overrides: dict[int, tuple[int, float]] = {}  # channel: pulse, end

    def set(self, channel: int, us: int) -> None:
        """Move a stick or switch; channels count from 1."""
        self._pulses[channel - 1] = us

    def lose(self) -> None:
        """Switch the transmitter off."""
        self.lost = True

    def restore(self) -> None:
        """Switch the transmitter on again."""
        self.lost = False

    def override(self, raw: tuple[int, ...], t: float) -> None:
        """Take the fields of an RC_CHANNELS_OVERRIDE, channel 1 first.

        65535 leaves a channel unchanged. Up to channel 8, 0 ends its override; above channel 8, 0
        leaves it unchanged and 65534 ends its override.
        """
        self.overridden_t = t
        for channel, us in enumerate(raw[:_CHANNELS], start=1):
            release, leave = (0, 0xFFFF) if channel <= 8 else (0xFFFE, 0)
            if us in (leave, 0xFFFF):
                continue
            if us == release:
                self._overrides.pop(channel, None)
            else:
                self._overrides[channel] = (us, t + _OVERRIDE_TIME_S)

    def channels(self, t: float) -> tuple[int, ...]:
        """Return the pulses in force, us."""
        pulses = list(self._pulses)
        for channel, (us, end) in self._overrides.items():
            if t < end:
                pulses[channel - 1] = us
        return tuple(pulses)

    def throttle_is_low(self, t: float) -> bool:
        """Tell whether the throttle stick is at its lower end."""
        return self.channels(t)[2] <= _THROTTLE_LOW_US
