"""The simulated camera: true edges, the tag's top, the vehicle in its own picture, timing."""

import asyncio
import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import RenderOptions
from hw.sim.picture.camera import SimCamera
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.ground import SKY
from hw.sim.picture.pad_texture import BLACK, WHITE
from hw.sim.picture.renderer import Renderer
from hw.sim.picture.shutter import Readout
from hw.sim.picture.view import Frustum, visible_markers
from hw.sim.snapshot import CameraPose, PadPose, Snapshot, VehiclePose
from landerd.camera_model import load_camera
from landerd.geometry import (
    IDENTITY,
    R_GIMBAL_CAMERA,
    Vec3,
    add,
    matmul,
    rot_zyx,
    rotate,
    sub,
    transpose,
)
from landerd.messages import ExposureOrder, Frame
from landerd.pad import PadLayout, load_pad
from landerd.ports import DeviceLost
from landerd.runtime.clock import run_realtime, run_virtual

CONFIG = Path(__file__).parents[4] / "config"
CAMERA = load_camera(CONFIG / "cameras/thesis.yaml")
FRUSTUM = Frustum(CAMERA)
PAD = load_pad(CONFIG / "pads/thesis.yaml")
RING_ONLY = PadLayout(name="ring", markers=PAD.rings, plate=PAD.plate)
AT_ORIGIN = PadPose((0.0, 0.0, 0.0), IDENTITY)
FAR = PadPose((1e4, 0.0, 0.0), IDENTITY)
CLEAN = RenderOptions(
    noise_sigma=0.0, gradient=0.0, ground="plain", vehicle_shadow=False, legs=False
)
F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]


@pytest.fixture(scope="module")
def usual() -> Renderer:
    return Renderer(PAD, CAMERA, RenderOptions(), seed=1)


@pytest.fixture(scope="module")
def clean() -> Renderer:
    return Renderer(PAD, CAMERA, CLEAN, seed=1)


def looking(lens: Vec3, yaw_deg: float, pitch_deg: float, roll_deg: float = 0.0) -> CameraPose:
    angles = [math.radians(a) for a in (yaw_deg, pitch_deg, roll_deg)]
    return CameraPose(lens, matmul(rot_zyx(*angles), R_GIMBAL_CAMERA))


def flying(
    body: Vec3, heading_deg: float, gimbal_yaw_deg: float, gimbal_pitch_deg: float
) -> tuple[CameraPose, VehiclePose]:
    """A level vehicle and its camera, mounted as the default configuration says."""
    R = rot_zyx(math.radians(heading_deg), 0.0, 0.0)
    lens = add(body, rotate(R, (0.10, 0.0, 0.04)))
    camera = looking(lens, heading_deg + gimbal_yaw_deg, gimbal_pitch_deg)
    return camera, VehiclePose(body, R, (0.44, 0.26), 0.20)


def picture(renderer: Renderer, pose: CameraPose, vehicle: VehiclePose | None = None) -> U8:
    return renderer.render(0, pose, pose, AT_ORIGIN, vehicle)


def tag_corners(image: U8) -> F64 | None:
    """Corners (4, 2) of the pad's AprilTag from its printed top-left clockwise, as OpenCV sees."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(family).detectMarkers(image)
    if ids is None or ids.ravel().tolist() != [0]:
        return None
    # OpenCV's dictionary is upside down against the AprilTag project's (facts: detectors).
    return cast(F64, np.roll(corners[0][0], 2, axis=0).astype(np.float64))


def projected(pose: CameraPose, *points: Vec3) -> F64:
    R = transpose(pose.R_local_camera)
    return CAMERA.pixels(np.array([rotate(R, sub(p, pose.position)) for p in points]))


def ring_by_integration(pose: CameraPose, box: tuple[int, int, int, int]) -> F64:
    """Mean grey that each pixel of the box gets of ring, plate and ground, over many rays."""
    left, top, right, bottom = box
    n = max(5, min(16, 1200 // (right - left)))  # along the edge there are many
    inside = (np.arange(n) + 0.5) / n - 0.5
    x = (np.arange(left, right)[:, None] + inside).ravel()
    y = (np.arange(top, bottom)[:, None] + inside).ravel()
    rays = CAMERA.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    d = np.column_stack([rays, np.ones(len(rays))]) @ np.array(pose.R_local_camera).T
    hit = np.array(pose.position)[:2] - pose.position[2] * d[:, :2] / d[:, 2:]
    radius = np.hypot(hit[:, 0], hit[:, 1])
    ring, plate = PAD.rings[0], PAD.plate
    outer = ring.outer_diameter_m / 2
    level = np.where((radius < outer) & (radius > ring.inner_ratio * outer), BLACK, WHITE)
    north, east = hit.T
    on_plate = (north < plate.north_m) & (north > -plate.south_m)
    on_plate &= (east < plate.east_m) & (east > -plate.west_m)
    fine = np.where(on_plate, level, 90.0).reshape(len(y), len(x))
    return cast(F64, fine.reshape(bottom - top, n, right - left, n).mean(axis=(1, 3)))


@pytest.mark.parametrize(
    ("range_m", "pitch_deg"),
    [
        (28.0, -80.0),
        (24.0, -30.0),
        (9.0, -50.0),
        (4.0, -80.0),
        (2.5, -40.0),
        (1.6, -60.0),
    ],
)
def test_edges_lie_where_perspective_and_lens_put_them(range_m: float, pitch_deg: float) -> None:
    pitch = math.radians(pitch_deg)
    lens = (-range_m * math.cos(pitch) + 0.013, 0.021, range_m * math.sin(pitch))
    pose = looking(lens, 3.0, pitch_deg, roll_deg=7.0)
    seen = picture(Renderer(RING_ONLY, CAMERA, CLEAN, seed=1), pose).astype(np.float64)

    reach = 0.5 * max(1.0, CAMERA.fx / range_m)
    (cx, cy), margin = projected(pose, (0.0, 0.0, 0.0))[0], 1.2 * reach + 4
    box = (
        max(int(cx - margin), 4),
        max(int(cy - margin), 4),
        min(int(cx + margin), CAMERA.width - 4),
        min(int(cy + margin), CAMERA.height - 4),
    )
    wide = (box[0] - 4, box[1] - 4, box[2] + 4, box[3] + 4)
    true = cv2.GaussianBlur(ring_by_integration(pose, wide), (0, 0), CLEAN.defocus_px)
    gy, gx = np.gradient(true)
    cut = np.s_[4:-4, 4:-4]
    x, y = np.meshgrid(np.arange(true.shape[1]), np.arange(true.shape[0]))
    x, y = x - (cx - wide[0]), y - (cy - wide[1])
    difference = seen[box[1] : box[3], box[0] : box[2]] - true[cut]

    # Least squares for a shift along x and y and a growth about the ring's centre.
    growth = (gx * x + gy * y) / reach
    basis = np.stack([g[cut].ravel() for g in (gx, gy, growth)], axis=1)
    error_px, *_ = np.linalg.lstsq(basis, difference.ravel(), rcond=None)
    assert np.abs(error_px).max() < 0.01


@pytest.mark.parametrize("height_m", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
@pytest.mark.parametrize("heading_deg", [0.0, 115.0])
def test_opencv_reads_the_tag_with_its_top_to_the_pads_north(
    usual: Renderer, height_m: float, heading_deg: float
) -> None:
    pose = looking((0.75, 0.0, -height_m), heading_deg, -90.0)
    corners = tag_corners(picture(usual, pose))

    assert corners is not None
    half = 0.3125 / 2
    top_left, top_right = (0.75 + half, -half, 0.0), (0.75 + half, half, 0.0)
    bottom_right, bottom_left = (0.75 - half, half, 0.0), (0.75 - half, -half, 0.0)
    true = projected(pose, top_left, top_right, bottom_right, bottom_left)
    assert np.abs(corners - true).max() < 1.5  # whole-pixel corners of OpenCV's contours


@pytest.mark.parametrize("lens", [(-6.0, 2.0, -5.0), (-0.4, 0.3, -2.2)])
def test_a_tilted_turned_and_raised_pad_is_the_level_one_seen_from_elsewhere(
    clean: Renderer, lens: Vec3
) -> None:
    angles = [math.radians(a) for a in (70.0, -9.0, 12.0)]
    tilted = PadPose((0.0, 0.0, -0.6), rot_zyx(*angles))
    to_pad = transpose(tilted.R_local_pad)
    way = sub(tilted.position, lens)
    down = math.degrees(math.atan2(way[2], math.hypot(way[0], way[1])))
    pose = looking(lens, math.degrees(math.atan2(way[1], way[0])), -down)
    from_pad = CameraPose(
        rotate(to_pad, sub(lens, tilted.position)), matmul(to_pad, pose.R_local_camera)
    )
    seen = clean.render(0, pose, pose, tilted, None).astype(np.int16)
    level = picture(clean, from_pad).astype(np.int16)
    plate = [(1.0, 0.6, 0.0), (1.0, -0.6, 0.0), (-0.6, -0.6, 0.0), (-0.6, 0.6, 0.0)]
    inside = np.zeros(seen.shape, np.uint8)
    cv2.fillConvexPoly(inside, projected(from_pad, *plate).round().astype(np.int32), 1)
    assert inside.sum() > 3000
    assert np.abs(seen - level)[inside == 1].max() <= 1
    assert visible_markers(PAD, FRUSTUM, pose, tilted) == visible_markers(
        PAD, FRUSTUM, from_pad, AT_ORIGIN
    )


def test_nothing_is_seen_of_a_pad_from_below_its_plane(clean: Renderer) -> None:
    steep = PadPose((0.0, 0.0, -1.0), rot_zyx(0.0, math.radians(-30.0), 0.0))  # its south is high
    lens = (-12.0, 0.0, -4.0)  # above the landing point, but below the plane
    pose = looking(lens, 0.0, -14.0)
    assert visible_markers(PAD, FRUSTUM, pose, steep) == []
    assert visible_markers(PAD, FRUSTUM, pose, PadPose((0.0, 0.0, -1.0), IDENTITY)) != []
    image = clean.render(0, pose, pose, steep, None)
    assert set(np.unique(image)) <= set(np.unique(clean.render(0, pose, pose, FAR, None)))


def test_own_leg_hides_the_tag_when_the_heading_is_wrong(usual: Renderer) -> None:
    legless = Renderer(PAD, CAMERA, RenderOptions(legs=False), seed=1)
    aligned = flying((0.0, 0.0, -0.5), 0.0, 0.0, -38.0)
    askew = flying((0.0, 0.0, -0.5), 60.0, -60.0, -38.0)

    assert tag_corners(picture(usual, *aligned)) is not None
    assert tag_corners(picture(usual, *askew)) is None
    assert tag_corners(picture(legless, *askew)) is not None
    assert 1 in visible_markers(PAD, FRUSTUM, askew[0], AT_ORIGIN)


def test_shadow_falls_away_from_the_sun_on_the_ground_and_on_a_raised_pad() -> None:
    options = CLEAN.model_copy(
        update={"vehicle_shadow": True, "sun_elevation_deg": 45.0, "sun_azimuth_deg": 90.0}
    )
    renderer = Renderer(PAD, CAMERA, options, seed=1)
    body = (-0.5, 3.0, -2.0)
    _, vehicle = flying(body, 30.0, 0.0, -90.0)
    pose = looking((-0.5, 1.0, -4.0), 0.0, -90.0)
    # Light from the east at 45 degrees: 2 m up, so 2 m to the west.
    (x, y), (lit_x, lit_y) = projected(pose, (-0.5, 1.0, 0.0), (-0.5, 1.9, 0.0)).round().astype(int)
    image = picture(renderer, pose, vehicle)
    assert image[y, x] == pytest.approx(0.4 * 90, abs=2)  # darkness 0.6
    assert image[lit_y, lit_x] == pytest.approx(90, abs=1)

    raised = PadPose((0.0, 1.0, -1.0), IDENTITY)
    _, vehicle = flying((0.0, 2.0, -2.0), 30.0, 0.0, -90.0)
    pose = looking((0.0, 1.0, -4.0), 0.0, -90.0)
    x, y = projected(pose, (0.0, 1.0, -1.0))[0].round().astype(int)
    image = renderer.render(0, pose, pose, raised, vehicle)
    assert image[y, x] == pytest.approx(0.4 * WHITE, abs=3)


def test_shadow_edge_darkens_one_side_of_the_pad_only() -> None:
    options = CLEAN.model_copy(
        update={"shadow_edge": True, "shadow_edge_m": -0.3, "shadow_edge_heading_deg": 180.0}
    )
    pose = looking((0.0, 0.0, -3.0), 0.0, -90.0)
    image = picture(Renderer(PAD, CAMERA, options, seed=1), pose)
    (x, north), (_, south) = projected(pose, (0.52, 0.0, 0.0), (0.0, 0.0, 0.0)).round().astype(int)
    assert image[north, x] == WHITE
    assert image[south, x] == pytest.approx(0.4 * WHITE, abs=2)


def test_motion_smears_along_the_way_and_keeps_the_middle(clean: Renderer) -> None:
    middle = looking((0.0, 0.0, -4.0), 0.0, -90.0)
    start, end = (looking((0.0, e, -4.0), 0.0, -90.0) for e in (-0.05, 0.05))
    still = picture(clean, middle).astype(np.float64)
    moving = clean.render(0, start, end, AT_ORIGIN, None).astype(np.float64)

    x, y = projected(middle, (0.0, 0.0, 0.0))[0].round().astype(int)
    across, along = np.s_[y - 80 : y + 60, x], np.s_[y, x - 58 : x + 58]
    assert np.abs(np.diff(moving[along])).max() < 0.35 * np.abs(np.diff(still[along])).max()
    assert np.abs(np.diff(moving[across])).max() > 0.9 * np.abs(np.diff(still[across])).max()
    columns = np.arange(x - 58, x + 58)
    centres = [
        float((columns * (WHITE - image[along])).sum() / (WHITE - image[along]).sum())
        for image in (still, moving)
    ]
    assert centres[0] == pytest.approx(centres[1], abs=0.05)


def test_noise_is_new_in_every_frame_and_the_same_in_every_run(usual: Renderer) -> None:
    pose = looking((-2.0, 0.0, -4.0), 0.0, -60.0)
    again = Renderer(PAD, CAMERA, RenderOptions(), seed=1)
    first, second = (usual.render(i, pose, pose, AT_ORIGIN, None) for i in (7, 8))
    assert (again.render(7, pose, pose, AT_ORIGIN, None) == first).all()
    difference = first.astype(np.float64) - second
    assert difference.std() == pytest.approx(3.0 * math.sqrt(2.0), rel=0.05)


def test_sky_above_the_horizon_and_no_pad_from_behind_the_camera(clean: Renderer) -> None:
    # Over the pad, looking level and rolled: rays above the horizon meet the pad behind the camera.
    pose = looking((0.0, 0.0, -0.2), 0.0, 0.0, roll_deg=50.0)
    pixels = np.stack(np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height)), axis=-1)
    rays = CAMERA.rays(pixels.reshape(-1, 2).astype(np.float64)).reshape(*pixels.shape)
    down = rays @ np.array(pose.R_local_camera[2][:2]) + pose.R_local_camera[2][2]
    image = picture(clean, pose)
    assert (image[down < -0.02] == SKY).all()
    assert (image[down > 0.8] > 100).any()  # the plate below


def test_the_pad_has_no_back(clean: Renderer) -> None:
    beneath = looking((0.0, 0.0, 3.0), 0.0, 90.0)
    assert np.ptp(picture(clean, beneath)) == 0
    assert visible_markers(PAD, FRUSTUM, beneath, AT_ORIGIN) == []


def test_markers_count_as_visible_only_where_they_are() -> None:
    assert visible_markers(PAD, FRUSTUM, looking((0, 0, -5), 0, -90), AT_ORIGIN) == [0, 1]
    assert visible_markers(PAD, FRUSTUM, looking((0.0, 0, -0.3), 0, -35), AT_ORIGIN) == [1]
    assert visible_markers(PAD, FRUSTUM, looking((0, 0, -5), 0, 10), AT_ORIGIN) == []
    cut = looking((0.2, 0, -0.3), 0, -90), AT_ORIGIN
    assert visible_markers(PAD, FRUSTUM, *cut) == []
    assert visible_markers(PAD, FRUSTUM, *cut, share=0.25) == [0]
    # Just over it of the ring the inner edge alone is in the picture.
    assert visible_markers(PAD, FRUSTUM, looking((0, 0, -0.5), 0, -90), AT_ORIGIN) == [0]
    assert visible_markers(PAD, FRUSTUM, looking((0, 0, 5), 0, -90), AT_ORIGIN) == []


# ---- delivery ----------------------------------------------------------------------------------

OPTIONS = SimCameraOptions(fps=30.0, exposure_s=0.008, latency_s=0.06, clock_offset_s=0.005)


def hovering(t: float) -> Snapshot:
    camera, vehicle = flying((0.0, 0.0, -3.0), 0.0, 0.0, -70.0)
    return Snapshot(t, camera, AT_ORIGIN, vehicle)


def with_camera(
    renderer: Renderer,
    use: Callable[[SimCamera], "asyncio.Future[None] | object"],
    truth: Callable[[float], Snapshot] = hovering,
    delivered: Callable[[Frame, Snapshot], None] | None = None,
    options: SimCameraOptions = OPTIONS,
) -> None:
    async def main() -> None:
        camera = SimCamera(renderer, truth, options, delivered, seed=1)
        await camera.open()
        await cast("asyncio.Future[None]", use(camera))
        await camera.close()

    run_virtual(main())


def test_in_real_time_a_picture_is_drawn_while_everything_else_goes_on(clean: Renderer) -> None:
    """Drawn in the event loop pictures delayed set-points by up to 90 ms."""
    others_went_on = threading.Event()

    class Slow:
        def render(self, *shot: Any) -> U8:
            assert others_went_on.wait(10.0)
            return clean.render(*shot)

        def brightness(self, image: U8) -> float:
            return clean.brightness(image)

    async def main() -> Frame:
        camera = SimCamera(Slow(), hovering, OPTIONS, seed=1, realtime=True)
        await camera.open()
        coming = asyncio.ensure_future(camera.newest())
        asyncio.get_running_loop().call_later(0.2, others_went_on.set)
        return await coming

    assert run_realtime(main()).seq > 0


def test_frames_come_at_their_rate_late_and_stamped_at_exposure(clean: Renderer) -> None:
    seen: list[Snapshot] = []

    async def use(camera: SimCamera) -> None:
        loop = asyncio.get_running_loop()
        frames = []
        for _ in range(10):
            frames.append(await camera.newest())
            # The stamp is off by the camera's clock, and the frame late by its latency.
            assert loop.time() - (frames[-1].t - 0.005) == pytest.approx(0.06)
        assert np.diff([f.t for f in frames]) == pytest.approx(1 / 30)
        assert [f.seq for f in frames] == list(range(frames[0].seq, frames[0].seq + 10))
        assert [s.t for s in seen] == pytest.approx([f.t - 0.005 for f in frames])

    with_camera(clean, use, delivered=lambda _, snapshot: seen.append(snapshot))


def test_a_slow_reader_gets_the_newest_frame_and_can_count_the_lost(clean: Renderer) -> None:
    async def use(camera: SimCamera) -> None:
        before = await camera.newest()
        await asyncio.sleep(0.51)
        after = await camera.newest()
        age = asyncio.get_running_loop().time() - (after.t - 0.005)
        assert age < 0.06 + 1 / 30
        assert after.seq - before.seq == round((after.t - before.t) * 30) >= 15

    with_camera(clean, use)


def test_a_camera_that_keeps_pace_with_the_pad_sees_it_sharp(clean: Renderer) -> None:
    def riding(t: float) -> Snapshot:
        way = (5.0 * t, 0.0, 0.0)
        s = hovering(t)
        camera = CameraPose(add(s.camera.position, way), s.camera.R_local_camera)
        return Snapshot(t, camera, PadPose(way, IDENTITY), s.vehicle)

    async def use(camera: SimCamera) -> None:
        image = (await camera.newest()).image.astype(np.float64)
        still = picture(clean, hovering(0.0).camera).astype(np.float64)
        x, y = projected(hovering(0.0).camera, (0.0, 0.0, 0.0))[0].round().astype(int)
        part = np.s_[y - 40 : y + 40, x - 40 : x + 40]
        assert np.abs(image[part] - still[part]).max() <= 1

    with_camera(clean, use, truth=riding)


def test_faults_show_at_the_protocol_and_pass(clean: Renderer) -> None:
    delivered: list[Frame] = []

    async def use(camera: SimCamera) -> None:
        good = await camera.newest()
        camera.faults.wrong_size = True
        assert (await camera.newest()).image.shape != good.image.shape
        camera.faults.wrong_size, camera.faults.wrong_type = False, True
        assert (await camera.newest()).image.dtype == np.uint16
        camera.faults.wrong_type, camera.faults.not_a_number = False, True
        assert np.isnan((await camera.newest()).image).all()
        camera.faults.not_a_number, camera.faults.frozen = False, True
        assert (await camera.newest()).t == good.t
        camera.faults.frozen, camera.faults.frozen_fresh = False, True
        fresh = [await camera.newest() for _ in range(3)]
        assert all(frame.image is good.image for frame in fresh)
        assert good.t < fresh[0].t < fresh[1].t < fresh[2].t
        assert good.seq < fresh[0].seq < fresh[1].seq < fresh[2].seq
        camera.faults.frozen_fresh, camera.faults.time_ahead_s = False, math.nan
        assert math.isnan((await camera.newest()).t)
        # The scorer hears of no frame that shows nothing new.
        assert [f.seq for f in delivered] == [good.seq]

        camera.faults.time_ahead_s, camera.faults.drop = 0.0, 1.0
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(camera.newest(), 1.0)
        camera.faults.drop = 0.0
        assert (await camera.newest()).t > good.t + 1.0

        camera.faults.disconnected = True
        with pytest.raises(DeviceLost):
            await camera.newest()
        with pytest.raises(DeviceLost):
            await camera.open()
        camera.faults.disconnected = False
        await camera.open()
        assert (await camera.newest()).t > delivered[1].t

    with_camera(clean, use, delivered=lambda frame, _: delivered.append(frame))


class Blank:
    """A renderer that draws one grey level, that of the light."""

    def __init__(self, light: Callable[[Exposure], float] = lambda _: 0.0) -> None:
        self.light = light
        self.exposures: list[Exposure] = []
        self.readouts: list[Readout] = []

    def brightness(self, image: U8) -> float:
        return float(image.mean()) / 255.0

    def render(
        self,
        frame_index: int,
        start: CameraPose,
        end: CameraPose,
        pad: PadPose,
        vehicle: VehiclePose | None,
        exposure: Exposure,
        readout: Readout | None,
    ) -> U8:
        self.exposures.append(exposure)
        if readout is not None:
            self.readouts.append(readout)
        return np.full((48, 64), round(255 * min(self.light(exposure), 1.0)), np.uint8)


def taken(
    renderer: Blank, pictures: int, **options: object
) -> list[tuple[float, float, float, int]]:
    """Arrival, stamp, time of the truth behind it, and number of each of so many pictures."""
    found: list[tuple[float, float, float, int]] = []
    truths: list[float] = []

    async def use(camera: SimCamera) -> None:
        loop = asyncio.get_running_loop()
        for _ in range(pictures):
            frame = await camera.newest()
            found.append((loop.time(), frame.t, truths[-1], frame.seq))

    with_camera(
        cast(Renderer, renderer),
        use,
        delivered=lambda _, snapshot: truths.append(snapshot.t),
        options=SimCameraOptions.model_validate(options),
    )
    return found


def test_stamps_are_off_by_the_offset_and_jitter_about_it() -> None:
    seen = taken(Blank(), 2000, clock_offset_s=-0.02, clock_jitter_s=0.003)
    arrived, stamp, true, _ = np.array(seen).T
    assert (stamp - true).mean() == pytest.approx(-0.02, abs=2e-4)
    assert (stamp - true).std() == pytest.approx(0.003, rel=0.05)
    # Nothing else jitters with them.
    assert np.diff(true) == pytest.approx(1 / 30)
    assert arrived - true == pytest.approx(0.06)


def test_exposures_jitter_about_an_even_beat() -> None:
    _, _, true, seq = np.array(taken(Blank(), 2000, fps_jitter=0.05)).T
    beat = true - seq / 30
    assert beat.std() == pytest.approx(0.05 / 30, rel=0.05)
    assert abs(beat[1000:].mean() - beat[:1000].mean()) < 3e-4  # it does not drift away
    assert np.diff(true).min() > 0.0


def test_late_pictures_keep_their_order_and_none_comes_before_it_is_read() -> None:
    options = {"latency_s": 0.03, "latency_jitter_s": 0.02, "readout_s": 0.02, "fps": 60.0}
    arrived, _, true, seq = np.array(taken(Blank(), 1500, **options)).T
    late = arrived - true
    assert late.min() == pytest.approx(0.5 * (0.02 + 0.008))
    assert (np.diff(arrived) >= 0.0).all()
    assert (np.diff(seq) >= 1).all()
    assert late.std() > 0.008
    assert late.mean() == pytest.approx(0.035, abs=0.007)  # cut off below, held up by others


def test_pictures_are_lost_at_their_rate() -> None:
    _, _, true, seq = np.array(taken(Blank(), 2000, drop=0.2)).T
    assert 1 - 2000 / (seq[-1] - seq[0] + 1) == pytest.approx(0.2, abs=0.02)
    assert true - seq / 30 == pytest.approx(true[0] - seq[0] / 30, abs=1e-6)


def test_effects_that_are_off_draw_no_random_number() -> None:
    plain = taken(Blank(), 50)
    assert taken(Blank(), 50, drop=0.0, fps_jitter=0.0) == plain
    # And one that is on does not disturb another.
    alone, both = (
        taken(Blank(), 50, clock_jitter_s=0.003, **other)
        for other in ({}, {"latency_jitter_s": 0.002})
    )
    assert [stamp - true for _, stamp, true, _ in alone] == pytest.approx(
        [stamp - true for _, stamp, true, _ in both]
    )


def test_auto_exposure_follows_the_pictures() -> None:
    light = Blank(lambda e: 0.1 * e.time_s * e.gain / 0.008)
    auto = {"target": 0.4, "lag_s": 0.2, "longest_s": 0.016}
    taken(light, 90, exposure="auto", auto_exposure=auto)
    first, last = light.exposures[0], light.exposures[-1]
    assert (first.time_s, first.gain) == (0.008, 1.0)
    assert last.time_s == 0.016
    assert last.gain == pytest.approx(2.0, rel=0.05)
    after = light.exposures[1 + round(0.2 * 30)]  # one lag after the first picture
    stops = math.log2(after.time_s * after.gain / 0.008)
    assert stops == pytest.approx((1 - math.exp(-1)) * 2.0, abs=0.1)


@pytest.mark.parametrize(("exposure", "obeys"), [("ordered", True), ("fixed", False)])
def test_an_ordered_exposure_shows_two_pictures_later(exposure: str, obeys: bool) -> None:
    blank = Blank()

    async def use(camera: SimCamera) -> None:
        await camera.newest()
        camera.expose(ExposureOrder(0.002, 3.0))
        for _ in range(8):
            await camera.newest()

    options = SimCameraOptions.model_validate({"exposure": exposure, "latency_s": 0.03})
    with_camera(cast(Renderer, blank), use, options=options)
    taken_as = [(e.time_s, e.gain) for e in blank.exposures]
    assert taken_as[:2] == [(0.008, 1.0)] * 2
    assert taken_as[5:] == [(0.002, 3.0) if obeys else (0.008, 1.0)] * 4


def test_rows_are_looked_up_at_their_own_times() -> None:
    blank = Blank()
    seen = taken(blank, 3, readout_s=0.02, clock_offset_s=0.0)
    for (_, stamp, true, _), readout in zip(seen, blank.readouts, strict=True):
        times = [s.t for s in readout.snapshots]
        assert times == pytest.approx(np.linspace(true - 0.01, true + 0.01, 5))
        assert stamp == true  # of the middle row
    assert taken(Blank(), 1) != []
    none = Blank()
    taken(none, 2)
    assert none.readouts == []


def test_with_all_effects_off_pictures_are_those_of_the_ideal_camera(usual: Renderer) -> None:
    other = Renderer(PAD, CAMERA, RenderOptions(), 1, SimCameraOptions())
    for i, pitch_deg in enumerate((-30.0, -60.0, -85.0)):
        start, end = (looking((-2.0, y, -4.0), 10.0, pitch_deg) for y in (0.0, 0.02))
        vehicle = VehiclePose((-2.1, 0.0, -4.1), IDENTITY, (0.44, 0.26), 0.2)
        pictures = [r.render(i, start, end, AT_ORIGIN, vehicle) for r in (usual, other)]
        assert (pictures[0] == pictures[1]).all()
