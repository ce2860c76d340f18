"""A square in its vehicle's sharp shadow, as the last metre of a landing in the sun shows it."""

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from landerd.geometry import rotation_vector
from landerd.pad import PadLayout
from landerd.vision.pose import Pose
from landerd.vision.print_edges import EdgeFit
from landerd.vision.print_fit import Fit
from landerd.vision.square import printed_cells
from landerd.vision.square_fit import SquarePrint
from tests.vision.scenes import THESIS_CAMERA, THESIS_PAD, Optics, View, look, render

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]
CAMERA = THESIS_CAMERA
TAG = THESIS_PAD.squares[0]
CENTRE = np.array([*TAG.position_m, 0.0])
BODY = np.array([-0.03, -0.02])  # its shadow's middle, from the tag's
CHI2_999 = 16.3  # three degrees of freedom
LIGHT_LEFT = 0.25  # in the sun's shadow
NOISELESS = Optics(noise=0.0)


def at(height: float) -> View:
    """Return a view in which the whole tag and half of the ring are in the picture."""
    return look(CAMERA, height, math.radians(30.0), pixel=(300.0, 420.0), heading=0.2)


def shadow(view: View) -> list[F64]:
    """Return the outlines (n, 2), px, of body and legs on the tag, as a low sun lays them there."""
    body = 0.11 * np.array([[math.cos(a), math.sin(a)] for a in np.arange(8) * math.pi / 4.0])
    parts = [body + BODY]
    for a in (0.4, 2.1, 3.4, 5.2):
        way, aside = np.array([math.cos(a), math.sin(a)]), np.array([-math.sin(a), math.cos(a)])
        hip, foot = 0.05 * way + BODY, 0.4 * way + BODY
        wide = 0.02 * aside
        parts.append(np.array([hip - wide, hip + wide, foot + 0.5 * wide, foot - 0.5 * wide]))
    flat = [np.column_stack([p, np.zeros(len(p))]) + CENTRE for p in parts]
    return [CAMERA.pixels(np.array(view.position) + p @ view.R_camera_pad.T) for p in flat]


def shaded(view: View, layout: PadLayout = THESIS_PAD) -> U8:
    """Return a picture of a pad with that shadow on it."""
    rng = np.random.default_rng(7)
    lit = render(view, CAMERA, Optics(noise=0.0), rng, layout).astype(np.float64)
    light = np.ones(lit.shape)
    for part in shadow(view):
        cv2.fillPoly(light, [np.rint(part * 16.0).astype(np.int32)], LIGHT_LEFT, shift=4)
    light = np.asarray(cv2.GaussianBlur(light, (0, 0), 0.8), dtype=np.float64)
    noisy = lit * light + rng.normal(0.0, 2.0, lit.shape)
    image: U8 = np.clip(noisy, 0, 255).astype(np.uint8)
    return image


def truth(view: View) -> F64:
    """Return the tag's centre, camera frame, m."""
    centre: F64 = np.array(view.position) + view.R_camera_pad @ CENTRE
    return centre


def tracked(view: View, image: U8) -> Fit | EdgeFit | None:
    """Return the fit from an expectation that is a centimetre and a degree off."""
    start = Pose(view.R_camera_pad, truth(view), np.zeros((6, 6)), 0.0)
    near = start.moved(np.array([0.006, -0.005, 0.008, 0.012, -0.01, 0.012]))
    return SquarePrint(TAG, printed_cells(TAG)).track(image, CAMERA, near)


@pytest.mark.parametrize("height", [0.7, 1.0, 1.4])
def test_a_tag_in_its_vehicles_shadow_is_tracked_to_millimetres(height: float) -> None:
    view = at(height)
    fit = tracked(view, shaded(view))
    assert fit is not None
    error = fit.pose.t - truth(view)
    assert np.linalg.norm(error) < 0.004
    covariance = np.linalg.inv(fit.pose.information)[:3, :3]
    assert math.sqrt(np.trace(covariance)) < 0.008
    assert error @ np.linalg.inv(covariance) @ error < CHI2_999
    turn = rotation_vector((fit.pose.R @ view.R_camera_pad.T).tolist())
    assert np.linalg.norm(turn) < math.radians(0.7)


@pytest.mark.parametrize("number", [7, 316, 417])
def test_another_tag_in_the_vehicles_shadow_is_not_taken_for_the_pads(number: int) -> None:
    view = at(1.0)
    other = TAG.model_copy(update={"id": number})
    layout = THESIS_PAD.model_copy(update={"markers": (other,)})
    assert tracked(view, shaded(view, layout)) is None


def dirty(view: View, layout: PadLayout = THESIS_PAD) -> U8:
    """Return a picture of a pad with dirt on the middle of its tag, as dark as its print."""
    angles = np.arange(24) * math.pi / 12.0
    return blotted(view, 0.1 * np.column_stack([np.cos(angles), np.sin(angles)]), layout)


def blotted(
    view: View, blot: F64, layout: PadLayout = THESIS_PAD, optics: Optics = NOISELESS
) -> U8:
    """Return a picture of a pad with a blot of an outline (n, 2), m from its tag's middle."""
    image = render(view, CAMERA, optics, np.random.default_rng(7), layout)
    outline = np.column_stack([blot, np.zeros(len(blot))]) + CENTRE
    px = CAMERA.pixels(np.array(view.position) + outline @ view.R_camera_pad.T)
    cv2.fillPoly(image, [np.rint(px * 16.0).astype(np.int32)], 45.0, shift=4)
    return image


@pytest.mark.parametrize("height", [0.7, 1.0, 1.2, 1.4, 1.7, 2.0])
def test_a_tag_with_dirt_on_its_code_is_tracked_by_its_border(height: float) -> None:
    view = at(height)
    fit = tracked(view, dirty(view))
    assert fit is not None
    assert np.linalg.norm(fit.pose.t - truth(view)) < 0.01


@pytest.mark.parametrize("number", [7, 316, 417])
def test_another_tag_with_dirt_on_its_code_is_not_taken_for_the_pads(number: int) -> None:
    other = TAG.model_copy(update={"id": number})
    layout = THESIS_PAD.model_copy(update={"markers": (other,)})
    assert tracked(at(1.0), dirty(at(1.0), layout)) is None


def test_a_dark_leg_before_a_faint_tag_does_not_pull_its_fit_aside() -> None:
    view = look(CAMERA, 1.44, 0.81, pixel=(403.0, 429.0), heading=-1.32, tilt_towards=2.75)
    leg = np.array([(0.102, 0.059), (0.087, 0.001), (-0.504, 0.115), (-0.469, 0.25)])
    image = blotted(view, leg, optics=Optics(white=200.0, black=100.0, noise=2.0))
    start = Pose(view.R_camera_pad, truth(view), np.zeros((6, 6)), 0.0)
    expected = start.moved(np.array([-0.004, 0.001, 0.002, -0.017, -0.029, -0.008]))
    fit = SquarePrint(TAG, printed_cells(TAG)).track(image, CAMERA, expected)
    assert fit is not None
    assert np.linalg.norm(fit.pose.t - truth(view)) < 0.005


def half_hidden(view: View, layout: PadLayout = THESIS_PAD) -> U8:
    """Return a picture of a pad with half of its tag under dirt as dark as its print."""
    blot = [(-0.17, -0.2), (-0.17, 0.03), (-0.05, -0.02), (0.02, 0.02), (0.08, -0.03), (0.17, 0.0)]
    return blotted(view, np.array([*blot, (0.17, -0.2)]), layout)


def glaring(
    view: View, aside: tuple[float, float], spot: tuple[float, float, float], layout: PadLayout
) -> U8:
    """Return a picture of a pad with a spot of glare near its tag.

    Args:
        view: of the pad.
        aside: of the spot from the tag's middle, camera frame, m.
        spot: how bright it is, grey levels, its standard deviation, m, and what share is left of
            the print's own contrast.
        layout: of the pad.
    """
    image = render(view, CAMERA, Optics(noise=0.0), np.random.default_rng(7), layout)
    x0, y0 = CAMERA.pixels((truth(view) + np.array([*aside, 0.0]))[None])[0]
    x, y = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    level, wide = spot[0], spot[1] * CAMERA.fx / truth(view)[2]
    veil = level * np.exp(-0.5 * ((x - x0) ** 2 + (y - y0) ** 2) / wide**2)
    lit: U8 = np.clip(spot[2] * image + 20.0 + veil, 0, 255).astype(np.uint8)
    return lit


def beside_glare(view: View, layout: PadLayout = THESIS_PAD) -> U8:
    """Return a picture of a pad with glare on a side of its tag."""
    return glaring(view, (0.05, 0.1), (150.0, 0.08, 0.6), layout)


def under_glare(view: View, layout: PadLayout = THESIS_PAD) -> U8:
    """Return a picture of a pad with glare on its whole tag: black is 0.85 of the white beside."""
    return glaring(view, (0.0, 0.0), (190.0, 0.12, 0.25), layout)


@pytest.mark.parametrize("height", [1.0, 1.4])
@pytest.mark.parametrize("shown", [half_hidden, beside_glare, under_glare])
def test_a_tag_that_is_half_hidden_or_under_glare_is_tracked_by_the_steps_of_its_code(
    shown: Callable[[View], U8], height: float
) -> None:
    view = at(height)
    fit = tracked(view, shown(view))
    assert fit is not None
    error = fit.pose.t - truth(view)
    assert np.linalg.norm(error) < 0.005
    assert error @ fit.pose.information[:3, :3] @ error < CHI2_999


@pytest.mark.parametrize("number", [7, 316, 417])
@pytest.mark.parametrize("shown", [half_hidden, beside_glare, under_glare])
def test_another_tag_half_hidden_or_under_glare_is_not_taken_for_the_pads(
    shown: Callable[[View, PadLayout], U8], number: int
) -> None:
    other = TAG.model_copy(update={"id": number})
    layout = THESIS_PAD.model_copy(update={"markers": (other,)})
    assert tracked(at(1.0), shown(at(1.0), layout)) is None


def test_a_shadow_on_a_plate_that_is_painted_over_is_no_tag() -> None:
    view = at(1.0)
    layout = THESIS_PAD.model_copy(update={"markers": THESIS_PAD.rings})
    assert tracked(view, shaded(view, layout)) is None


def test_a_tag_detected_in_the_vehicles_shadow_has_a_true_sigma() -> None:
    view = at(1.0)
    corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * 0.5 * TAG.size_m
    corners = np.column_stack([corners, np.zeros(4)]) + CENTRE
    px = CAMERA.pixels(np.array(view.position) + corners @ view.R_camera_pad.T)
    px += np.array([[1.5, 0.5], [-1.0, 1.0], [0.5, -1.5], [1.0, 1.0]])  # the decoder's, in shade
    image = shaded(view)
    poses, stage = SquarePrint(TAG, printed_cells(TAG)).poses(image, CAMERA, px)
    assert stage == "edges"
    error = poses[0].t - truth(view)
    assert np.linalg.norm(error) < 0.004
    assert error @ poses[0].information[:3, :3] @ error < 3.0 * CHI2_999
