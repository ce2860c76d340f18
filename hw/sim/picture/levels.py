"""The grey levels of pad and ground for a simulation with modelled sight, which draws no picture.

They stand for what `sensor` would make of the light, and depend on the exposure likewise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.pad_texture import BLACK, WHITE
from hw.sim.picture.tone import STEPS, tone_levels

# Mean grey levels of the grounds of `ground` and `terrain` under full light.
GROUND = {
    "grass": 92.0, "asphalt": 78.0, "plain": 90.0,
    "meadow": 28.0, "gravel": 56.0, "paving": 70.0, "canopy": 14.0, "roof": 50.0,
    "car_park": 40.0, "water": 11.0,
}  # fmt: skip
_PHOTOGRAPH = 60.0  # the same of any photograph, assumed
_WHITE_SHARE = 0.7  # share of a plate that is white; the rest is black print


@dataclass(frozen=True)
class Levels:
    """Grey levels of one exposure."""

    white: float
    black: float
    ground: float
    noise: float  # standard deviation of the noise halfway between black and white
    clipped: float  # light of white over the most that the sensor can hold; above 1: clipped

    @property
    def contrast(self) -> float:
        """Difference of white and black, grey levels."""
        return self.white - self.black


class Sensitivity:
    """Turns exposures into grey levels of evenly lit surfaces."""

    def __init__(self, render: RenderOptions, camera: SimCameraOptions, pad: PadOptions) -> None:
        """Take light and noise, the sensor, and the pad's print."""
        self._render, self._camera = render, camera
        ink = BLACK if pad.black is None else pad.black * WHITE
        self._scene = np.array(
            [WHITE, ink, GROUND.get(str(render.ground), _PHOTOGRAPH), 0.5 * (WHITE + ink)]
        )
        self._grey = tone_levels(camera.tone, camera.black_level)
        self._known: dict[Exposure, Levels] = {}

    def levels(self, exposure: Exposure | None) -> Levels:
        """Return the grey levels of an exposure; None: the one that the illumination is set for."""
        exposure = exposure or Exposure(self._camera.exposure_s)
        found = self._known.get(exposure)
        if found is None:
            found = self._known[exposure] = self._levels(exposure)
        return found

    def brightness(self, exposure: Exposure | None, pad_share: float) -> float:
        """Return the mean of a picture, share of full scale.

        Args:
            exposure: see `levels`.
            pad_share: share of the picture that the pad fills.
        """
        levels = self.levels(exposure)
        pad = _WHITE_SHARE * levels.white + (1.0 - _WHITE_SHARE) * levels.black
        return (pad_share * pad + (1.0 - pad_share) * levels.ground) / 255.0

    def _levels(self, exposure: Exposure) -> Levels:
        render, camera = self._render, self._camera
        amplified = exposure.time_s * exposure.gain / camera.exposure_s
        light = self._scene * (render.illumination * amplified)
        white, black, ground, _ = self._grey_of(light)
        # Noise of the photon transfer curve (see `sensor`), times the slope of the tone curve.
        read = render.noise_sigma * exposure.gain
        lit = min(float(light[3]), 255.0)
        sigma = (read * read + camera.noise.shot * exposure.gain * lit) ** 0.5
        ends = self._grey_of(np.array([lit - 8.0, lit + 8.0]))
        slope = (ends[1] - ends[0]) / 16.0
        return Levels(white, black, ground, float(sigma * slope), float(light[0]) / 255.0)

    def _grey_of(self, light: NDArray[np.float64]) -> list[float]:
        """Return the grey levels of light, 255 of which is full scale."""
        at = np.clip(light, 0.0, 255.0) * ((STEPS - 1) / 255.0)
        return [float(grey) for grey in np.interp(at, np.arange(STEPS), self._grey)]
