"""Tone curves against their formulas."""

import numpy as np
import pytest

from hw.sim.camera_options import ToneOptions
from hw.sim.picture.tone import tone, tone_levels

LIGHT = np.linspace(0.0, 1.0, 101)


def test_linear_is_the_light_itself() -> None:
    assert (tone(LIGHT, ToneOptions()) == LIGHT).all()


def test_gamma_and_srgb_are_the_standards_curves() -> None:
    assert tone(LIGHT, ToneOptions(curve="gamma", gamma=1.8)) == pytest.approx(LIGHT ** (1 / 1.8))
    # Of the standard: 18 % grey is 118, and the curve joins its straight foot.
    srgb = 255 * tone(np.array([0.18, 0.0031307, 0.0031309]), ToneOptions(curve="srgb"))
    assert srgb[0] == pytest.approx(117.6, abs=0.1)
    assert srgb[1] == pytest.approx(srgb[2], abs=0.01)


@pytest.mark.parametrize("curve", ["linear", "srgb", "gamma", "contrast"])
@pytest.mark.parametrize("contrast", [0.0, 0.5, 1.0])
def test_every_curve_rises_from_black_to_white(curve: str, contrast: float) -> None:
    grey = tone(LIGHT, ToneOptions.model_validate({"curve": curve, "contrast": contrast}))
    assert (grey[0], grey[-1]) == (0.0, pytest.approx(1.0))
    assert (np.diff(grey) > 0.0).all()


def test_contrast_steepens_the_middle_by_its_share() -> None:
    near = np.array([0.499, 0.501])
    slope = np.diff(tone(near, ToneOptions(contrast=0.4)))[0] / 0.002
    assert slope == pytest.approx(0.6 + 0.4 * 1.5, abs=1e-4)
    vivid = tone(LIGHT, ToneOptions(curve="contrast"))
    assert vivid == pytest.approx(tone(LIGHT, ToneOptions(curve="srgb", contrast=1.0)))


def test_black_level_lifts_black_and_leaves_white() -> None:
    levels = tone_levels(ToneOptions(curve="srgb"), 16.0)
    assert (levels[0], levels[-1]) == (16.0, pytest.approx(255.0))
