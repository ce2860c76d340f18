"""Rolling shutter and vibration: every row lies where its own pose puts it."""

import math
from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
import pytest
from numpy.typing import NDArray

from hw.sim.camera_options import SimCameraOptions, VibrationOptions
from hw.sim.options import RenderOptions
from hw.sim.picture.pad_texture import WHITE
from hw.sim.picture.renderer import Renderer
from hw.sim.picture.shutter import EVERYTHING, Readout, RolledPlane, RowGrid, Vibration
from hw.sim.picture.view import matrix, plane_homography
from hw.sim.snapshot import CameraPose, PadPose, Snapshot, VehiclePose
from landerd.camera_model import load_camera
from landerd.geometry import IDENTITY, R_GIMBAL_CAMERA, Mat3, Vec3, matmul, rot_zyx
from landerd.pad import PadLayout, load_pad

CONFIG = Path(__file__).parents[4] / "config"
CAMERA = load_camera(CONFIG / "cameras/thesis.yaml")
PAD = load_pad(CONFIG / "pads/thesis.yaml")
SPOT = PAD.rings[0].model_copy(update={"outer_diameter_m": 0.1})
PLATE = PadLayout(name="plate", markers=(SPOT,), plate=PAD.plate)  # its edges far from all else
CLEAN = RenderOptions(
    noise_sigma=0.0, gradient=0.0, ground="plain", vehicle_shadow=False, legs=False
)
VEHICLE = VehiclePose((0.0, 0.0, -9.0), IDENTITY, (0.44, 0.26), 0.2)
GROUND = 90.0
READOUT_S, T = 0.03, 2.0
F64 = NDArray[np.float64]
World = Callable[[float], Snapshot]


def look(yaw: float, pitch: float, roll: float) -> Mat3:
    return matmul(rot_zyx(yaw, pitch, roll), R_GIMBAL_CAMERA)


def world(
    lens: Vec3,
    pitch_deg: float,
    *,
    rates: Vec3 = (0.0, 0.0, 0.0),
    velocity: Vec3 = (0.0, 0.0, 0.0),
    pad_velocity: Vec3 = (0.0, 0.0, 0.0),
    pad_turn: float = 0.0,
) -> World:
    """A camera that turns (yaw, pitch, roll, rad/s) and flies over a pad that moves."""

    def at(t: float) -> Snapshot:
        d = t - T
        n, e, h = (p + v * d for p, v in zip(lens, velocity, strict=True))
        yaw, pitch, roll = (r * d for r in rates)
        camera = CameraPose((n, e, h), look(yaw, math.radians(pitch_deg) + pitch, roll))
        x, y, z = (v * d for v in pad_velocity)
        return Snapshot(t, camera, PadPose((x, y, z), rot_zyx(pad_turn * d, 0.0, 0.0)), VEHICLE)

    return at


def readout(truth: World, vibration: Vibration | None = None, exposure_s: float = 0.004) -> Readout:
    times = [T + READOUT_S * (k / 6 - 0.5) for k in range(7)]
    return Readout(T, READOUT_S, exposure_s, tuple(truth(t) for t in times), vibration)


def homography(truth: World, t: float, turn: F64) -> F64:
    """From rays to the pad at one time, of a camera that vibration has turned about x and y."""
    s = truth(t)
    x, y = turn
    R = matrix(s.camera.R_local_camera) @ (
        np.eye(3) + np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
    )
    rows: Mat3 = tuple(tuple(row) for row in R.tolist())  # type: ignore[assignment]
    H = plane_homography(CameraPose(s.camera.position, rows), s.pad)
    assert H is not None
    return H


FAST = world(
    (-3.0, 1.0, -5.0),
    -55.0,
    rates=(1.5, 2.0, 0.5),
    velocity=(4.0, -3.0, 1.0),
    pad_velocity=(5.0, 1.0, 0.3),
    pad_turn=0.4,
)


@pytest.mark.parametrize("shakes", [False, True])
def test_each_row_has_the_homography_of_its_time(shakes: bool) -> None:
    x, y = np.arange(-1.0, CAMERA.width + 1), np.arange(-1.0, CAMERA.height + 1)
    grid = RowGrid(CAMERA, x, y)
    vibration = Vibration(VibrationOptions(deg=0.15, hz=110.0), Random(2)) if shakes else None
    middle = FAST(T).pad
    H = homography(FAST, T, np.zeros(2))
    rolled = RolledPlane(grid, H, readout(FAST, vibration).homographies(grid, middle, middle))
    rays = np.concatenate([rolled.rays(EVERYTHING), np.ones((len(y), len(x), 1))], axis=-1)
    straight = rolled.texels(EVERYTHING, H)
    assert straight is not None
    largest = 0.0
    for row in range(0, len(y), 37):
        t = T + READOUT_S * (y[row] - 239.5) / 480
        turn = np.zeros(2)
        if vibration is not None:
            turn = vibration.turns(np.array([t]), 0.004)[0]
        pixels = np.column_stack([x, np.full(len(x), y[row])])
        true = np.column_stack([CAMERA.rays(pixels), np.ones(len(x))]) @ homography(FAST, t, turn).T
        true = true[:, :2] / true[:, 2:]
        pixel_m = np.hypot(*np.gradient(true, axis=0).T)[:, None]
        seen = rays[row] @ H.T
        assert (np.abs(seen[:, :2] / seen[:, 2:] - true) / pixel_m).max() < 0.02
        assert (np.abs(np.stack([s[row] for s in straight], -1) - true) / pixel_m).max() < 0.02
        still = np.column_stack([CAMERA.rays(pixels), np.ones(len(x))]) @ H.T
        largest = max(largest, float((np.abs(still[:, :2] / still[:, 2:] - true) / pixel_m).max()))
    assert largest > 20.0  # what there was to be found


def edge(image: NDArray[np.uint8], rows: NDArray[np.int64], x: F64) -> F64:
    """Column where each row passes from ground to plate near x, by the area under the step."""
    found = []
    for row, near in zip(rows.tolist(), np.rint(x).astype(int).tolist(), strict=True):
        part = image[row, near - 8 : near + 9].astype(float)
        found.append(near + 8.5 - ((part - GROUND) / (WHITE - GROUND)).sum())
    return np.array(found)


def west_edge(truth: World) -> tuple[NDArray[np.int64], F64]:
    """Rows of the picture, and where in each the plate's west edge is when the row is exposed."""
    along = np.linspace(-0.55, 0.95, 400)
    points = np.column_stack([along, np.full(400, -PAD.plate.west_m), np.zeros(400)])
    t = np.full(400, T)
    for _ in range(6):
        cameras = [truth(at).camera for at in t.tolist()]
        seen = [
            (p - np.array(c.position)) @ matrix(c.R_local_camera)
            for p, c in zip(points, cameras, strict=True)
        ]
        x, y = CAMERA.pixels(np.array(seen)).T
        t = T + READOUT_S * (y - 239.5) / 480
    order = np.argsort(y)
    rows = np.arange(math.ceil(y.min()) + 3, math.floor(y.max()) - 3)
    return rows, np.interp(rows, y[order], x[order])


@pytest.mark.parametrize("height", [4.0, 14.0])
@pytest.mark.parametrize("turns", [False, True])
def test_an_edge_leans_by_readout_and_speed(height: float, turns: bool) -> None:
    rates = (1.2, 0.0, 0.0) if turns else (0.0, 0.0, 0.0)  # the camera looks straight down
    velocity = (0.0, 0.0 if turns else height, 0.0)
    truth = world((0.2, -0.3, -height), -90.0, rates=rates, velocity=velocity)
    renderer = Renderer(PLATE, CAMERA, CLEAN, 1, SimCameraOptions(readout_s=READOUT_S))
    pose, pad = truth(T).camera, truth(T).pad
    image = renderer.render(1, pose, pose, pad, None, readout=readout(truth))
    rows, x = west_edge(truth)
    error = edge(image, rows, x) - x
    assert abs(error.mean()) < 0.03
    assert np.abs(error).max() < 0.2  # of one row: grey levels are whole numbers

    if not turns:  # what is below passes at as many pixels a second as the focal length
        still = renderer.render(1, pose, pose, pad, None)
        upright = edge(still, rows, x)
        lean = np.polyfit(rows, x - upright, 1)[0]
        assert lean == pytest.approx(-CAMERA.fx * READOUT_S / 480, rel=0.1)


def test_without_motion_a_rolling_shutter_changes_nothing() -> None:
    truth = world((-4.0, 0.5, -6.0), -50.0)
    options = SimCameraOptions(readout_s=READOUT_S)
    rolling = Renderer(PAD, CAMERA, RenderOptions(), 1, options)
    pose, pad = truth(T).camera, truth(T).pad
    seen = rolling.render(3, pose, pose, pad, VEHICLE, readout=readout(truth)).astype(int)
    still = Renderer(PAD, CAMERA, RenderOptions(), 1).render(3, pose, pose, pad, VEHICLE)
    assert np.abs(seen - still).max() <= 3
    assert (seen != still).mean() < 0.01


def test_the_mean_and_the_spread_of_a_vibration_over_an_exposure() -> None:
    vibration = Vibration(VibrationOptions(deg=0.5, hz=80.0), Random(3))
    amplitude, exposure_s = math.radians(0.5), 0.009
    t = np.linspace(0.0, 1.0, 4001)
    assert np.abs(vibration.turns(t)).max() == pytest.approx(amplitude, rel=1e-3)
    within = exposure_s * ((np.arange(200) + 0.5) / 200 - 0.5)
    spread = []
    for middle in np.arange(0.2, 0.2125, 0.0005):  # all phases
        path = vibration.turns(middle + within)
        mean = vibration.turns(np.array([middle]), exposure_s)[0]
        assert path.mean(axis=0) == pytest.approx(mean, abs=1e-3 * amplitude)
        spread.append(path.var(axis=0))
    assert math.sqrt(np.mean(spread)) == pytest.approx(vibration.shaking(exposure_s), rel=0.01)
    assert vibration.shaking(0.0) == 0.0


def test_vibration_blurs_where_nothing_else_does() -> None:
    truth = world((0.0, 0.0, -4.0), -90.0)
    pose, pad = truth(T).camera, truth(T).pad
    options = SimCameraOptions.model_validate({"vibration": {"deg": 0.2, "hz": 200.0}})
    renderer = Renderer(PLATE, CAMERA, CLEAN, 1, options)
    vibration = Vibration(options.vibration, Random(1))
    # Whole periods: no row is moved, every edge is smeared.
    shaken = Readout(T, 0.0, 0.01, (truth(T),), vibration)
    seen = renderer.render(1, pose, pose, pad, None, readout=shaken)[240].astype(float)
    still = renderer.render(1, pose, pose, pad, None)[240].astype(float)
    x = np.arange(len(seen))
    near = x < CAMERA.cx

    def width(row: F64) -> float:
        slope = np.abs(np.diff(row))[near[1:]]
        place = (x[1:][near[1:]] * slope).sum() / slope.sum()
        return float((slope * (x[1:][near[1:]] - place) ** 2).sum() / slope.sum())

    sigma = CAMERA.fx * math.radians(0.2) / math.sqrt(2.0)
    assert width(seen) - width(still) == pytest.approx(sigma**2, rel=0.15)
