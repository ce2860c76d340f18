"""Grey levels that a sensor gives pad and ground, where no picture is made."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.pad_texture import BLACK, WHITE
from hw.sim.picture.tone import STEPS, tone_levels

# Mean brightness of the grounds, grey levels under full light: `ground.py` and `terrain.py`.
GROUND = {
    "grass": 92.0, "asphalt": 78.0, "plain": 90.0,
    "meadow": 28.0, "gravel": 56.0, "paving": 70.0, "canopy": 14.0, "roof": 50.0,
    "car_park": 40.0, "water": 11.0,
}  # fmt: skip
_PHOTOGRAPH = 60.0
_WHITE_SHARE = 0.7  # of a plate; the rest is print


@dataclass(frozen=True)
class Levels:
    """What a picture gives, grey levels."""

    white: float
    black: float
    ground: float
    noise: float  # standard deviation, halfway between black and white
    clipped: float  # light on white over what the sensor can hold; 1 and less: not clipped

    @property
    def contrast(self) -> float:
        """From black to white."""
        return self.white - self.black


class Sensitivity:
    """Turns exposures into grey levels; light falls evenly."""

    def __init__(self, render: RenderOptions, camera: SimCameraOptions, pad: PadOptions) -> None:
        self._render, self._camera = render, camera
        ink = BLACK if pad.black is None else pad.black * WHITE
        self._scene = np.array(
            [WHITE, ink, GROUND.get(str(render.ground), _PHOTOGRAPH), 0.5 * (WHITE + ink)]
        )
        self._grey = tone_levels(camera.tone, camera.black_level)
        self._known: dict[Exposure, Levels] = {}

    def levels(self, exposure: Exposure | None) -> Levels:
        """Return those of an exposure; None: as the illumination has it."""
        exposure = exposure or Exposure(self._camera.exposure_s)
        found = self._known.get(exposure)
        if found is None:
            found = self._known[exposure] = self._levels(exposure)
        return found

    def brightness(self, exposure: Exposure | None, pad_share: float) -> float:
        """Return the mean of a picture of which the pad fills a share, share of full scale."""
        levels = self.levels(exposure)
        pad = _WHITE_SHARE * levels.white + (1.0 - _WHITE_SHARE) * levels.black
        return (pad_share * pad + (1.0 - pad_share) * levels.ground) / 255.0

    def _levels(self, exposure: Exposure) -> Levels:
        render, camera = self._render, self._camera
        amplified = exposure.time_s * exposure.gain / camera.exposure_s
        light = self._scene * (render.illumination * amplified)
        white, black, ground, _ = self._grey_of(light)
        # Variance of the photon transfer curve, brought through the tone curve by its slope.
        read = render.noise_sigma * exposure.gain
        lit = min(float(light[3]), 255.0)
        sigma = (read * read + camera.noise.shot * exposure.gain * lit) ** 0.5
        ends = self._grey_of(np.array([lit - 8.0, lit + 8.0]))
        slope = (ends[1] - ends[0]) / 16.0
        return Levels(white, black, ground, float(sigma * slope), float(light[0]) / 255.0)

    def _grey_of(self, light: NDArray[np.float64]) -> list[float]:
        at = np.clip(light, 0.0, 255.0) * ((STEPS - 1) / 255.0)
        return [float(grey) for grey in np.interp(at, np.arange(STEPS), self._grey)]
