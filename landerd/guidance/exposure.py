"""How the camera is to expose: by the pad's white once it is seen, by the ground before.

Every order is waited for before the next: pictures taken under the old exposure say nothing about
the new one. How much light a grey level means depends on the camera's tone curve, which nobody
knows; a step in proportion to the level is right for a linear one and falls short of the aim with
any gamma, so it closes in from either side. Blurred sight is worse than noisy sight: beyond the
short exposure comes gain. But gain lifts the noise with the light, and vision loses a small ring
to noise sooner than to the dark (white at 40 with noise of 3 was seen from afar, at 100 with 7
not): gain is used only up to a fifth of the level aimed at.
"""

import math

from landerd.config.models import MeteringSection
from landerd.geometry import clamp
from landerd.messages import CLIPPED_LEVEL, ExposureOrder, Light, Sightings

# Grey levels aimed at. White at four fifths of full scale leaves room for noise and for a light
# that is not even. Grass, earth and asphalt give back a quarter of what white does.
WHITE_LEVEL, GROUND_LEVEL = 200.0, 70.0
CLIPPED_STEP = 0.4  # to which the exposure is cut where something is clipped,
BLINDED_STEP = 0.16  # and where most of the picture is
DARKEST_LEVEL = 4.0  # from here down a level says only that it is too dark
BLINDING = 0.5  # share of the picture that is clipped: what is to be seen in it is lost
GLARING = 2e-4  # share of the ground that may be a far pad: a ring of 6 px with its plate
ROUGHLY = 2.0  # so near the ground's level is enough for the shorter turns to begin
SHORTER_TURNS = 3  # white then fits, had it been 15 times over full scale
DIM = 0.2  # share of the level aimed at that is enough where more would need gain
BAND = 1.15  # a level that is off by less is left
# From an order to the pictures exposed by it: so many of them, and so long at the least, for the
# order's own way and the camera's clock.
SETTLED_FRAMES, SETTLED_S = 3, 0.1
PAD_KEEP_S = 2.0  # after the pad's last picture its light still holds, under the same exposure


class ExposureControl:
    """Turns the brightness of pictures into orders for the camera."""

    def __init__(self, options: MeteringSection) -> None:
        self._options = options
        # Seconds at gain 1.
        self._least = options.shortest_s
        self._most = options.longest_s * options.gain_max
        self._amount = self._before = options.short_s
        self._ordered_t = -math.inf
        self._frame: tuple[float, int] | None = None  # time and number of the last
        self._period_s = 0.0  # of the camera
        self._pad_t = -math.inf
        self._has_ordered = False
        self._ground: float | None = None  # the amount to go back to from shorter turns
        self._turns = 0

    def on_sightings(self, now: float, sightings: Sightings) -> ExposureOrder | None:
        """Take a frame's brightness; return the order that follows, if any.

        Args:
            now: s.
            sightings: of a frame exposed after all before.
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
        """Return the order after a picture that was exposed for the ground."""
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
        """Return the order for the next shorter exposure, after the last for that of the ground."""
        shorter = CLIPPED_STEP * self._amount
        self._turns += 1
        if light.clipped < GLARING or self._turns > SHORTER_TURNS or shorter < self._least:
            shorter = self._ground or self._amount
            self._ground = None
        return self._order(now, shorter)

    def _back(self, now: float) -> ExposureOrder:
        """Return the order for the exposure before, which showed the pad when the next was due."""
        self._ground = None
        return self._order(now, self._before)

    def _brought(self, now: float, level: float, wanted: float) -> ExposureOrder | None:
        """Return the order that brings a level to the one wanted; None: it is near enough."""
        amount = self._wanted(level, wanted)
        if max(amount / self._amount, self._amount / amount) < BAND:
            return None
        return self._order(now, amount)

    def _wanted(self, level: float, wanted: float) -> float:
        """Return what is to be exposed, s at gain 1, for a level to become the one wanted."""
        step = CLIPPED_STEP if level >= CLIPPED_LEVEL else wanted / max(level, DARKEST_LEVEL)
        full = self._amount * step
        dim = max(DIM * full, min(full, self._options.short_s))
        return clamp(dim, self._least, self._most)

    def _order(self, now: float, amount: float) -> ExposureOrder:
        self._ordered_t, self._before, self._amount = now, self._amount, amount
        o = self._options
        gain = clamp(amount / o.short_s, 1.0, o.gain_max)
        return ExposureOrder(amount / gain, gain)
