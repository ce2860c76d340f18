"""Turns the light in the image plane into the picture that a camera delivers.

The order is that in a camera: lens (vignetting, dirt), exposure and gain, photon and amplifier
noise, clipping at the full well, tone curve, sharpening, JPEG. Noise follows the photon transfer
curve (Janesick, "Photon Transfer", 2007; EMVA 1288): its variance is that of the amplifier times
the gain squared, plus a part proportional to light and gain.
"""

import math
import random

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import SimCameraOptions, ToneOptions
from hw.sim.options import RenderOptions
from hw.sim.picture import lens
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.jpeg import Jpeg
from hw.sim.picture.tone import STEPS, tone_levels
from landerd.camera_model import CameraModel

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

# Number of offsets along x and along y at which a picture takes its noise from a larger field.
NOISE_MARGIN = 256
WIDEST = 4.5  # largest noise in the table, standard deviations
HALO_PX = 3  # side of the square whose mean the unsharp mask subtracts


class Sensor:
    """The sensor of one camera, which exposes one picture after another."""

    def __init__(
        self, camera: CameraModel, render: RenderOptions, options: SimCameraOptions, seed: int
    ) -> None:
        """Prepare the map of the light, the noise and the tables.

        Args:
            camera: its size and principal point.
            render: light and noise.
            options: of the sensor.
            seed: of noise, dirt, and the direction of the light's gradient.
        """
        self._render = render
        self._options = options
        self._seed = seed
        w, h = camera.width, camera.height
        rng = np.random.default_rng([seed, 2])
        bearing = rng.uniform(0.0, 2.0 * math.pi)
        ramp = np.add.outer(
            math.sin(bearing) * np.linspace(-1.0, 1.0, h),
            math.cos(bearing) * np.linspace(-1.0, 1.0, w),
        )
        # Light on the sensor over that of the scene.
        self._light = (render.illumination * (1.0 + render.gradient * ramp)).astype(np.float32)
        if options.vignetting > 0.0:
            self._light *= lens.vignetting(camera, options.vignetting)
        if options.lens_dirt > 0.0:
            spots = np.random.default_rng([seed, 3])
            self._light *= lens.dirt(w, h, options.lens_dirt, spots)
        noise = rng.standard_normal((h + NOISE_MARGIN, w + NOISE_MARGIN), dtype=np.float32)
        self._is_ideal = _is_ideal(options)
        if self._is_ideal:
            noise = np.clip(np.rint(render.noise_sigma * noise), -255, 255)
            # Two parts of the image's own type take a tenth of the time of signed noise.
            self._brighter = np.maximum(noise, 0.0).astype(np.uint8)
            self._darker = np.maximum(-noise, 0.0).astype(np.uint8)
        else:
            self._brightest = float(self._light.max())
            self._light /= self._brightest
            noise = np.clip(np.rint(127.0 / WIDEST * noise), -128, 127)
            self._draws = (noise + 128).astype(np.uint8)
            self._index = np.empty((h, w, 2), np.uint8)
            levels = tone_levels(options.tone, options.black_level)
            self._grey_of = np.rint(levels).astype(np.uint8)
            self._table_of: tuple[Exposure, U8] | None = None
        self._jpeg = Jpeg(w, h, options.jpeg_quality) if options.jpeg_quality else None

    def expose(self, scene: U8, frame_index: int, exposure: Exposure | None = None) -> U8:
        """Turn the light of a scene into the delivered picture, in place.

        Args:
            scene: light (height, width), 255 is full light; changed and returned.
            frame_index: of the picture, which determines its noise.
            exposure: time and gain; None: those that the illumination is set for.
        """
        offsets = random.Random(self._seed * 1_000_003 + frame_index)
        x, y = offsets.randrange(NOISE_MARGIN), offsets.randrange(NOISE_MARGIN)
        part = (slice(y, y + scene.shape[0]), slice(x, x + scene.shape[1]))
        cv2.multiply(scene, self._light, dst=scene, dtype=cv2.CV_8U)
        if self._is_ideal:
            cv2.add(scene, self._brighter[part], dst=scene)
            cv2.subtract(scene, self._darker[part], dst=scene)
        else:
            # Light and noise of a pixel make one index into a table of everything up to the tone
            # curve.
            cv2.merge((self._draws[part], scene), dst=self._index)
            exposure = exposure or Exposure(self._options.exposure_s)
            cv2.LUT(self._index.view("<u2")[..., 0], self._table(exposure), dst=scene)
        if self._options.sharpening > 0.0:
            _sharpen(scene, self._options.sharpening)
        if self._jpeg is not None:
            self._jpeg.compress(scene)
        return scene

    def _table(self, exposure: Exposure) -> U8:
        """Return the grey levels (65536,) of 256 levels of light, each with 256 values of noise."""
        if self._table_of is not None and self._table_of[0] == exposure:
            return self._table_of[1]
        o, gain = self._options, np.float32(exposure.gain)
        amplified = exposure.time_s * exposure.gain / o.exposure_s * self._brightest
        light = np.arange(256, dtype=np.float32)[:, None] * np.float32(amplified)
        read = np.float32(self._render.noise_sigma) * gain
        sigma = np.sqrt(read * read + np.float32(o.noise.shot) * gain * light)
        draws = (np.arange(256, dtype=np.float32) - 128) * np.float32(WIDEST / 127.0)
        digital = (light + sigma * draws) * np.float32((STEPS - 1) / 255.0)
        digital = np.clip(np.rint(digital), 0, STEPS - 1)
        table: U8 = self._grey_of[digital.astype(np.intp)].ravel()
        self._table_of = (exposure, table)
        return table


def _is_ideal(options: SimCameraOptions) -> bool:
    """Tell whether grey levels are proportional to light, and noise does not depend on it."""
    return (
        options.tone == ToneOptions(gamma=options.tone.gamma)
        and options.black_level == 0.0
        and options.noise.shot == 0.0
        and options.exposure == "fixed"
    )


def _sharpen(image: U8, share: float) -> None:
    """Sharpen an image in place: add a share of the unsharp mask."""
    soft = cv2.blur(image, (HALO_PX, HALO_PX), borderType=cv2.BORDER_REPLICATE)
    cv2.addWeighted(image, 1.0 + share, soft, -share, 0.0, dst=image)
