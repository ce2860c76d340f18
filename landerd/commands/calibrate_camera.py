"""`landerd calibrate camera`: calibrates a lens from pictures of a board, as ROS camera_info."""

import argparse
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from landerd.calibration.board import Board, Charuco, Chessboard, View
from landerd.calibration.lens import (
    Calibration,
    Lens,
    calibrate,
    coverage,
    not_trusted,
    outliers,
    too_poor,
)
from landerd.camera_model import camera_info, left_out
from landerd.commands.detect import SourceError, pictures
from landerd.commands.shared import (
    InputError,
    add_json,
    check_folder,
    file_name,
    number,
    print_json,
    refusing,
    tell,
    write_text,
)

# A frame of a video or camera is kept if the board has moved by less than this since the frame
# before, mean of its corners, px: then it is not blurred by motion.
_STILL_PX = 2.0
# A frame is kept if the board is farther than this from where each kept frame has it, px.
_NEW_PX = 40.0
_MOST_VIEWS = 40  # number of kept frames after which a video or camera is left


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help="images, folders of images, a video or a camera (/dev/video0; Ctrl-C when done)",
    )
    parser.add_argument(
        "--board",
        choices=("chessboard", "charuco"),
        default="chessboard",
        help="kind of the board (chessboard)",
    )
    parser.add_argument(
        "--size",
        type=_size,
        required=True,
        metavar="COLUMNSxROWS",
        help="chessboard: inner corners, as 9x6; charuco: squares, as 8x11",
    )
    parser.add_argument(
        "--square", type=_length, required=True, metavar="M", help="side of a square, measured"
    )
    parser.add_argument("--marker", type=_length, metavar="M", help="charuco: side of a marker")
    parser.add_argument(
        "--dictionary",
        default="4X4_50",
        metavar="NAME",
        help="charuco: dictionary of its markers (4X4_50)",
    )
    parser.add_argument(
        "--lens",
        choices=("plumb_bob", "rational", "fisheye"),
        default="plumb_bob",
        help="model of the distortion: rational beyond 90 degrees of view, fisheye beyond 120 "
        "(plumb_bob)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=file_name,
        metavar="FILE.yaml",
        help="write the calibration into this file; without: print it",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Calibrate and write the result; return 0, or 1 if the result cannot be trusted.

    Raises:
        InputError: an argument or a source cannot be used, or the file cannot be written.
    """
    with refusing(ValueError, SourceError):
        board = _board(args)
        check_folder(args.output)
        views, size, seen = _views(board, args.sources, quiet=args.json)
    lens: Lens = args.lens
    result, reasons = None, too_poor(views, size)
    if not reasons:
        try:
            result = calibrate(board, views, size, lens)
            reasons = not_trusted(result, views)
        except ValueError as e:
            reasons = [str(e)]
    if args.json:
        print_json(_as_json(result, reasons, views, size, seen))
    else:
        print(_in_words(result, reasons, views, size, seen))
    if result is None or reasons:
        return 1
    if remark := left_out(result.camera):
        tell(remark)
    text = camera_info(result.camera, args.output.stem if args.output else "camera")
    if args.output is not None:
        write_text(args.output, text)
        if not args.json:
            print(f"written: {args.output}")
    elif not args.json:
        print(text, end="")
    return 0


def _board(args: argparse.Namespace) -> Board:
    """Return the board. Raises InputError without --marker, ValueError for a wrong board."""
    columns, rows = args.size
    if args.board == "chessboard":
        return Chessboard(columns, rows, args.square)
    if args.marker is None:
        raise InputError("--marker is needed with --board charuco: the side of a marker in m")
    return Charuco(columns, rows, args.square, args.marker, args.dictionary)


# ---- views -------------------------------------------------------------------------------------


def _views(
    board: Board, sources: Sequence[str], *, quiet: bool
) -> tuple[list[View], tuple[int, int], int]:
    """Search all pictures for the board.

    Args:
        board: what is searched for.
        sources: images, folders, videos and cameras.
        quiet: whether no progress is printed.

    Returns:
        The kept views of the board, width and height of the pictures (0 without any), and the
        number of pictures searched.

    Raises:
        SourceError: a source cannot be read.
        ValueError: the pictures differ in size.
    """
    views: list[View] = []
    size: tuple[int, int] | None = None
    seen = 0
    before: View | None = None
    try:
        for source in sources:
            is_stream = False
            for picture in pictures(source, lambda e: tell(str(e))):
                height, width = picture.image.shape
                size = size or (width, height)
                if size != (width, height):
                    raise ValueError(
                        f"{picture.name} is {width}x{height}, those before it {size[0]}x{size[1]}"
                    )
                seen += 1
                is_stream = is_stream or picture.follows
                view = board.find(picture.name, picture.image)
                if view is not None and (not is_stream or _is_new(view, before, views)):
                    views.append(view)
                    if is_stream and not quiet:
                        parts = coverage(views, size)
                        print(f"{len(views)} views, {parts.sum()} of {parts.size} parts covered")
                before = view
                if is_stream and len(views) >= _MOST_VIEWS:
                    break
    except KeyboardInterrupt:
        pass  # Ctrl-C ends the calibration of a live camera
    return views, size or (0, 0), seen


def _is_new(view: View, before: View | None, views: Sequence[View]) -> bool:
    """Tell whether the board stands still, and elsewhere than in all kept views.

    Args:
        view: the board in this frame.
        before: the board in the frame before; None: it was not found there.
        views: the kept views.
    """
    still = before is not None and _moved_px(view, before) < _STILL_PX
    return still and all(_moved_px(view, kept) > _NEW_PX for kept in views)


def _moved_px(a: View, b: View) -> float:
    """Return the mean distance of the corners common to both views, px; infinite without any."""
    common, in_a, in_b = np.intersect1d(a.ids, b.ids, return_indices=True)
    if not len(common):
        return math.inf
    return float(np.mean(np.linalg.norm(a.corners_px[in_a] - b.corners_px[in_b], axis=1)))


# ---- output ------------------------------------------------------------------------------------


def _as_json(
    result: Calibration | None,
    reasons: list[str],
    views: Sequence[View],
    size: tuple[int, int],
    seen: int,
) -> dict[str, Any]:
    report: dict[str, Any] = {
        "good": result is not None and not reasons,
        "reasons": reasons,
        "images": seen,
        "views": len(views),
        "covered": float(coverage(views, size).mean()) if views else 0.0,
    }
    if result is not None:
        camera = result.camera
        report |= {
            "focal_px": [camera.fx, camera.fy],
            "centre_px": [camera.cx, camera.cy],
            "distortion": list(camera.distortion),
            "error_px": result.error_px,
            "focal_sigma": result.focal_sigma,
            "image_errors_px": {v.name: e for v, e in zip(views, result.errors_px, strict=True)},
        }
    return report


def _in_words(
    result: Calibration | None,
    reasons: list[str],
    views: Sequence[View],
    size: tuple[int, int],
    seen: int,
) -> str:
    lines = [f"board found in {len(views)} of {seen} pictures"]
    if views:
        lines.append("corners in these parts of the picture (. is none):")
        lines += ["  " + " ".join(".#"[int(c)] for c in row) for row in coverage(views, size)]
    if result is not None:
        camera = result.camera
        bad = outliers(result)
        for i, view in enumerate(views):
            mark = "  much worse than the others: leave it out" if i in bad else ""
            lines.append(
                f"  {view.name}: {result.errors_px[i]:.3f} px, "
                f"tilted {result.tilts_deg[i]:.0f} degrees{mark}"
            )
        known = f" (1 sigma {100 * result.focal_sigma:.2f} %)"
        lines.append(
            f"focal length {camera.fx:.2f}, {camera.fy:.2f} px{known}, centre "
            f"{camera.cx:.2f}, {camera.cy:.2f} px, reprojection error {result.error_px:.3f} px"
        )
    lines += [f"refused: {reason}" for reason in reasons]
    return "\n".join(lines)


def _size(text: str) -> tuple[int, int]:
    """Return columns and rows of a board; the type of --size."""
    columns, _, rows = text.partition("x")
    ok = all(part.isascii() and part.isdecimal() and 2 < int(part) < 50 for part in (columns, rows))
    if not ok:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected as 9x6")
    return int(columns), int(rows)


def _length(text: str) -> float:
    """Return a length on the board in m; the type of --square and --marker."""
    value = number(text)
    if not 0.0 < value < 10.0:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected metres, as 0.025")
    return value
