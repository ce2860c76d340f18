"""Exposure control: by the pad's white once it is seen, by the ground before.

Each order takes effect before the next is made: pictures taken under the old exposure say nothing
about the new one. A step in proportion to the grey level is right for a linear tone curve and falls
short with any gamma, so that it converges from either side whatever the camera's curve is.

Motion blur is worse than noise: above the short exposure (`short_s`) gain is raised first. But gain
amplifies noise too, and vision loses a small ring to noise sooner than to the dark (white at 40
with noise of 3 was seen from afar, at 100 with 7 not): gain is used only up to a fifth of the
desired level.
"""

import math

from landerd.config.models import MeteringSection
from landerd.geometry import clamp
from landerd.messages import CLIPPED_LEVEL, ExposureOrder, Light, Sightings

# Desired grey levels. White at four fifths of full scale leaves room for noise and uneven light.
# Grass, earth and asphalt reflect a quarter of what white does.
WHITE_LEVEL, GROUND_LEVEL = 200.0, 70.0
CLIPPED_STEP = 0.4  # factor on the exposure where something is clipped
BLINDED_STEP = 0.16  # factor on the exposure where most of the picture is clipped
DARKEST_LEVEL = 4.0  # lower levels say no more than "too dark"
BLINDING = 0.5  # clipped share of the picture from which on nothing can be seen in it
GLARING = 2e-4  # clipped share of the ground that may be a far pad: a ring of 6 px with its plate
ROUGHLY = 2.0  # factor within which the ground's level must be before shorter exposures are tried
SHORTER_TURNS = 3  # shorter exposures tried: white fits then, had it been 15 times over full scale
DIM = 0.2  # share of the desired level that is enough where more would need gain
BAND = 1.15  # factor within which a level is left alone
# From an order to the pictures exposed by it: this many of them, and at least this time, s, for the
# order's way to the camera and the error of its clock.
SETTLED_FRAMES, SETTLED_S = 3, 0.1
PAD_KEEP_S = 2.0  # how long after the pad's last picture its exposure is kept, s


class ExposureControl:
    """Turns the brightness of pictures into orders for the camera."""

    def __init__(self, options: MeteringSection) -> None:
        self._options = options
        # Exposures as amounts of light: s at gain 1.
        self._least = options.shortest_s
        self._most = options.longest_s * options.gain_max
        self._amount = self._before = options.short_s
        self._ordered_t = -math.inf
        self._frame: tuple[float, int] | None = None  # time (s) and number of the last
        self._period_s = 0.0  # between the camera's frames
        self._pad_t = -math.inf
        self._has_ordered = False
        self._ground: float | None = None  # amount for the ground while shorter ones are tried
        self._turns = 0  # shorter ones tried so far

    def on_sightings(self, now: float, sightings: Sightings) -> ExposureOrder | None:
        """Take a frame's brightness; return the order that follows, if any.

        Args:
            now: s.
            sightings: of a frame newer than all before.
        """
        light = sightings.light
        self._note_period(sightings)
        if light is None:
            return None
        if not self._has_ordered:
            self._has_ordered = True
            return self._order(now, self._amount)
        settled_t = self._ordered_t + max(SETTLED_S, SETTLED_FRAMES * self._period_s)
        if light.on_pad:
            self._pad_t = sightings.t
        elif self._pad_t >= settled_t and sightings.t - self._pad_t < PAD_KEEP_S:
            return None
        if sightings.t < settled_t:
            was_before = light.on_pad and sightings.t < self._ordered_t
            return self._back(now) if was_before and self._ground is not None else None
        if light.on_pad:
            self._ground = None
            return self._brought(now, light.level, WHITE_LEVEL)
        if self._ground is None:
            return self._on_ground(now, light)
        return self._shorter(now, light)

    def _note_period(self, sightings: Sightings) -> None:
        """Learn how often pictures are taken; not all of them are searched."""
        if self._frame is not None and sightings.seq > self._frame[1]:
            self._period_s = (sightings.t - self._frame[0]) / (sightings.seq - self._frame[1])
        self._frame = sightings.t, sightings.seq

    def _on_ground(self, now: float, light: Light) -> ExposureOrder | None:
        """Return the order that follows a picture exposed for the ground."""
        if light.clipped >= BLINDING and self._amount > self._least:
            return self._order(now, max(BLINDED_STEP * self._amount, self._least))
        is_glaring = light.clipped >= GLARING
        is_near = 1.0 / ROUGHLY < light.level / GROUND_LEVEL < ROUGHLY
        if not (is_glaring and is_near):
            order = self._brought(now, light.level, GROUND_LEVEL)
            if order is not None or not is_glaring:
                return order
        self._ground = self._amount = self._wanted(light.level, GROUND_LEVEL)
        self._turns = 0
        return self._shorter(now, light)

    def _shorter(self, now: float, light: Light) -> ExposureOrder:
        """Return the order for the next shorter exposure; after the last, for the ground's."""
        shorter = CLIPPED_STEP * self._amount
        self._turns += 1
        if light.clipped < GLARING or self._turns > SHORTER_TURNS or shorter < self._least:
            shorter = self._ground or self._amount
            self._ground = None
        return self._order(now, shorter)

    def _back(self, now: float) -> ExposureOrder:
        """Return the order for the exposure before the last order: that one showed the pad."""
        self._ground = None
        return self._order(now, self._before)

    def _brought(self, now: float, level: float, wanted: float) -> ExposureOrder | None:
        """Return the order that brings a grey level to the desired one; None: near enough."""
        amount = self._wanted(level, wanted)
        if max(amount / self._amount, self._amount / amount) < BAND:
            return None
        return self._order(now, amount)

    def _wanted(self, level: float, wanted: float) -> float:
        """Return the exposure (s at gain 1) that brings a grey level to the desired one."""
        step = CLIPPED_STEP if level >= CLIPPED_LEVEL else wanted / max(level, DARKEST_LEVEL)
        full = self._amount * step
        dim = max(DIM * full, min(full, self._options.short_s))
        return clamp(dim, self._least, self._most)

    def _order(self, now: float, amount: float) -> ExposureOrder:
        self._ordered_t, self._before, self._amount = now, self._amount, amount
        o = self._options
        gain = clamp(amount / o.short_s, 1.0, o.gain_max)
        return ExposureOrder(amount / gain, gain)
