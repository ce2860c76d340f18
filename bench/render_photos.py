"""Compares grey levels, edge widths and noise of photographs to those of simulated pictures.

    python -m bench.render_photos FOLDER... [--pictures 60] [--sheet FILE.png]

There is a column for each folder of photographs, and a last one for the field scenario (seeds 1 to
N, the pad in view from 2 to 15 m). All pictures are first resized to a width of 640 pixels, so that
edges can be compared. As that reduces the noise of larger ones, `noise, own pixels` is measured
before.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.exposure import AutoExposure, Exposure
from hw.sim.picture.lens import true_camera
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.devices import sim_options
from landerd.drivers import read_configuration
from landerd.geometry import IDENTITY, R_GIMBAL_CAMERA, matmul, rot_zyx
from landerd.pad import load_pad

U8 = NDArray[np.uint8]
F64 = NDArray[np.float64]

WIDTH = 640  # px, of all pictures
ENDINGS = {".jpg", ".jpeg", ".png", ".bmp", ".pnm"}
GREY_PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
# Bins of grey levels in which noise is measured.
BINS = ((0, 32), (32, 64), (64, 96), (96, 128), (128, 160), (160, 192), (192, 240))
BLOCK = 8  # side of a block of pixels, px
FLATTEST = 0.05  # quantile of the blocks' deviations that is the noise: texture only adds to it
BLOCKS = 200  # least number of a picture's blocks in a bin
# That quantile of a sample's standard deviation over the true one, with 61 degrees of freedom.
FLAT_SHARE = 0.87
STEP = 40.0  # least contrast of an edge, grey levels
REACH = 8.0  # length of a profile to either side of an edge, px
PER_PIXEL = 4  # samples of a profile per pixel
EDGES = 400  # number of edge pixels of a picture that are measured


# ---- what is measured ----------------------------------------------------------------------------


def noise_of_levels(image: U8) -> list[float]:
    """Return the noise of each bin of grey levels, grey levels; NaN: there are too few blocks.

    The noise of a block is its deviation from a fitted plane; that of the flattest blocks is the
    sensor's.
    """
    h, w = (n // BLOCK * BLOCK for n in image.shape)
    blocks = image[:h, :w].reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).swapaxes(1, 2)
    values = blocks.reshape(-1, BLOCK * BLOCK).astype(np.float64)
    y, x = np.indices((BLOCK, BLOCK)).reshape(2, -1)
    plane = np.linalg.qr(np.column_stack([np.ones_like(x), x, y]))[0]
    left = values - values @ plane @ plane.T
    deviation = np.sqrt((left**2).sum(axis=1) / (BLOCK * BLOCK - 3))
    mean = values.mean(axis=1)
    noise = []
    for least, most in BINS:
        of_level = deviation[(mean >= least) & (mean < most)]
        enough = len(of_level) >= BLOCKS
        noise.append(float(np.quantile(of_level, FLATTEST)) / FLAT_SHARE if enough else math.nan)
    return noise


def edge_widths(image: U8) -> list[float]:
    """Return the widths of edges between two even grey levels, from 10 to 90 %, px."""
    soft = cv2.GaussianBlur(image, (0, 0), 1.0)
    gx, gy = (cv2.Sobel(soft, cv2.CV_32F, *way, ksize=3) / 8.0 for way in ((1, 0), (0, 1)))
    steep = np.hypot(gx, gy)
    ys, xs = np.nonzero(cv2.Canny(soft, 40, 80))
    inside = (xs > 12) & (ys > 12) & (xs < image.shape[1] - 12) & (ys < image.shape[0] - 12)
    ys, xs = ys[inside], xs[inside]
    chosen = Random(1).sample(range(len(ys)), min(EDGES, len(ys)))
    widths = []
    for y, x in zip(ys[chosen], xs[chosen], strict=True):
        way = np.array([gx[y, x], gy[y, x]]) / max(float(steep[y, x]), 1e-6)
        width = _width(_profile(image, float(x), float(y), way))
        if width is not None:
            widths.append(width)
    return widths


def _profile(image: U8, x: float, y: float, way: F64) -> F64:
    """Return grey levels along `way`, a unit vector across an edge, as the mean of three lines."""
    t = np.arange(-REACH, REACH + 0.01, 1 / PER_PIXEL)[None, :]
    aside = np.array([-1.0, 0.0, 1.0])[:, None]
    at_x = (x + t * way[0] - aside * way[1]).astype(np.float32)
    at_y = (y + t * way[1] + aside * way[0]).astype(np.float32)
    across = np.array(cv2.remap(image, at_x, at_y, cv2.INTER_LINEAR), np.float64)
    return np.asarray(across.mean(axis=0), np.float64)


def _width(profile: F64) -> float | None:
    """Return the width of an edge from 10 to 90 %, px; None: it is not between even levels."""
    quarter = len(profile) // 4
    low, high = profile[:quarter], profile[-quarter:]
    step = high.mean() - low.mean()
    if step < STEP or max(np.ptp(low), np.ptp(high)) > 0.25 * step:
        return None
    share = (profile - low.mean()) / step
    start = _crossing(share, 0.1)
    end = _crossing(share, 0.9)
    return (end - start) / PER_PIXEL if end > start else None


def _crossing(share: F64, level: float) -> float:
    """Return the index at which a profile last rises through a level before it reaches 90 %."""
    above = int(np.argmax(share >= 0.9))
    below = np.nonzero(share[: above + 1] < level)[0]
    if not len(below) or below[-1] + 1 >= len(share):
        return 0.0
    i = int(below[-1])
    return i + float((level - share[i]) / max(share[i + 1] - share[i], 1e-9))


class Figures:
    """What was measured in the pictures of one column."""

    def __init__(self, name: str, pictures: Iterator[U8]) -> None:
        """Measure all pictures; the name is the column's."""
        self.name = name
        self.count = 0
        self.shown: list[U8] = []
        self._grey: list[F64] = []
        self._clipped: list[tuple[float, float]] = []
        self._widths: list[float] = []
        self._noise: list[list[float]] = []
        self._own_noise: list[list[float]] = []
        for picture in pictures:
            self.count += 1
            self._own_noise.append(noise_of_levels(picture))
            height = round(picture.shape[0] * WIDTH / picture.shape[1])
            shrinks = cv2.INTER_AREA if picture.shape[1] > WIDTH else cv2.INTER_LINEAR
            small = np.asarray(
                cv2.resize(picture, (WIDTH, height), interpolation=shrinks), np.uint8
            )
            self._grey.append(np.percentile(small, GREY_PERCENTILES))
            self._clipped.append((float((small <= 2).mean()), float((small >= 253).mean())))
            # Quantiles give each picture the same weight, however many edges it has.
            widths = edge_widths(small)
            if len(widths) >= 5:
                self._widths += np.quantile(widths, (0.1, 0.3, 0.5, 0.7, 0.9)).tolist()
            self._noise.append(noise_of_levels(small))
            self.shown.append(small)

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield names of quantities and their figures: the median, and 10 to 90 % of pictures."""
        yield "pictures", str(self.count)
        for i, percentile in enumerate(GREY_PERCENTILES):
            yield f"grey, {percentile} %", _spread([g[i] for g in self._grey], 0)
        yield "at or under 2, %", _spread([100 * black for black, _ in self._clipped], 1)
        yield "at or over 253, %", _spread([100 * white for _, white in self._clipped], 1)
        yield "edge 10-90 %, px", _spread(self._widths, 1)
        for title, noise in (("noise", self._noise), ("noise, own pixels", self._own_noise)):
            for i, (least, most) in enumerate(BINS):
                seen = [n[i] for n in noise if not math.isnan(n[i])]
                yield f"{title} at {least}-{most}", f"{_spread(seen, 1)} ({len(seen)})"


def _spread(values: Sequence[float], digits: int) -> str:
    """Return the text of the median, and of the 10th and 90th percentiles."""
    if not values:
        return "-"
    low, middle, high = np.quantile(values, (0.1, 0.5, 0.9))
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


# ---- pictures ------------------------------------------------------------------------------------


def photographs(folder: Path) -> Iterator[U8]:
    """Yield all photographs of a folder in grey."""
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in ENDINGS:
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            if image is not None:
                yield np.asarray(image, np.uint8)


def field_pictures(count: int) -> Iterator[U8]:
    """Yield a picture of each of a number of days of the field scenario."""
    for seed in range(1, count + 1):
        yield field_picture(seed)


def field_picture(seed: int) -> U8:
    """Return a picture of a day, with settled exposure, from a random place near the pad."""
    folder = config_dir()
    overlays = [folder / "scenarios/field.yaml"]
    options = sim_options(read_configuration(folder / "default.yaml", overlays=overlays, seed=seed))
    camera, pad = options.camera, options.pad.model_copy(update={"position_m": (0.0, 0.0)})
    lens = true_camera(load_camera(folder / "cameras/thesis.yaml"), camera.calibration_error)
    layout = printed(load_pad(folder / "pads/thesis.yaml"), pad, seed)
    renderer = Renderer(layout, lens, options.render, seed, camera, pad)
    where = Random(seed)
    range_m, pitch = where.uniform(2.0, 15.0), -math.radians(where.uniform(35.0, 90.0))
    heading = where.uniform(-math.pi, math.pi)
    level = range_m * math.cos(pitch)
    place = (-level * math.cos(heading), -level * math.sin(heading), range_m * math.sin(pitch))
    pose = CameraPose(place, matmul(rot_zyx(heading, pitch, 0.0), R_GIMBAL_CAMERA))
    ahead = 0.10  # of the vehicle's centre, m: the camera's place in config/default.yaml
    body = (
        place[0] - ahead * math.cos(heading),
        place[1] - ahead * math.sin(heading),
        place[2] - 0.04,
    )
    vehicle = VehiclePose(body, rot_zyx(heading, 0.0, 0.0), (0.44, 0.26), 0.20)
    at = PadPose((0.0, 0.0, 0.0), IDENTITY)

    def draw(exposure: Exposure) -> U8:
        return renderer.render(seed, pose, pose, at, vehicle, exposure)

    if camera.exposure == "fixed":
        return draw(Exposure(camera.exposure_s))
    auto = AutoExposure(camera)
    for i in range(12):
        auto.see(cv2.mean(draw(auto.exposure))[0] / 255.0, float(i))
    return draw(auto.exposure)


def sheet(pictures: Sequence[U8], columns: int = 6) -> U8:
    """Return one picture of all pictures, small, in rows."""
    small = [cv2.resize(p, (213, 160), interpolation=cv2.INTER_AREA) for p in pictures]
    small += [np.zeros_like(small[0])] * (-len(small) % columns)
    rows = [np.hstack(small[i : i + columns]) for i in range(0, len(small), columns)]
    return np.asarray(np.vstack(rows), np.uint8)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--pictures", type=int, default=20, metavar="N", help="of the field world")
    parser.add_argument("--sheet", type=Path, metavar="FILE.png", help="the field world's pictures")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    all_figures = [Figures(folder.name, photographs(folder)) for folder in args.folders]
    all_figures.append(Figures("field world", field_pictures(args.pictures)))
    columns = [list(figures.rows()) for figures in all_figures]
    print("| |" + "".join(f" {figures.name} |" for figures in all_figures))
    print("|---|" + "---|" * len(columns))
    for cells in zip(*columns, strict=True):
        print(f"| {cells[0][0]} |" + "".join(f" {value} |" for _, value in cells))
    if args.sheet is not None:
        cv2.imwrite(str(args.sheet), sheet(all_figures[-1].shown))


if __name__ == "__main__":
    main()
