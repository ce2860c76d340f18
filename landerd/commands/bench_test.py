"""`landerd bench-test`: measures camera and gimbal with the pad on marks on the floor.

These are the thesis's experiments of chapter 4, done before the first flight.
"""

import argparse
import asyncio
import csv
import io
import math
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from landerd.calibration.bench import Refused
from landerd.calibration.marks import (
    Mark,
    MarkTrial,
    Search,
    Seen,
    pose_errors,
    swing_errors,
)
from landerd.camera_model import CalibrationError, CameraModel
from landerd.commands.shared import (
    InputError,
    add_bench,
    ask,
    check_bench,
    load_with_saved,
    metres,
    print_json,
    refusing,
    tell,
    whole_number,
    write_text,
)
from landerd.config.files import Loaded
from landerd.config.models import MAX_HEADING_DEG
from landerd.devices import SetUpError, fitting_camera, make_devices
from landerd.messages import Frame, Prior, Sightings
from landerd.pad import PadError, PadLayout, load_pad
from landerd.ports import DeviceLost, Feedback, GimbalOptions
from landerd.runtime.clock import run_virtual
from landerd.runtime.daemon import Devices
from landerd.vision import Vision
from landerd.worker import JobHangs, Worker

_SEARCH_S = 5.0  # a search of a picture that takes longer counts as hung
_FARTHEST_M = 50.0  # largest distance of a mark, ahead or to the right
_NEXT = "Lay the pad flat, its landing point on the mark {mark}, its north where the nose points."


class _Figure(NamedTuple):
    """One measured figure of a row, with the limits that it is judged by."""

    name: str
    value: float | None  # None: it could not be measured, and is not judged
    go: float  # up to this the verdict is "go"
    no_go: float  # above this it is "no-go": landerd should not fly; between the limits "look"
    unit: str

    @property
    def verdict(self) -> str:
        """The verdict on the figure: "go", "look" or "no-go"."""
        if self.value is None or self.value <= self.go:
            return "go"
        return "look" if self.value <= self.no_go else "no-go"  # NaN: no-go


class _Row(NamedTuple):
    """The figures of one mark, or of one turn of the gimbal there."""

    what: str  # name of the mark, and of the turn
    figures: Sequence[_Figure]

    @property
    def verdict(self) -> str:
        """The worst verdict of the figures."""
        verdicts = [figure.verdict for figure in self.figures]
        return next((v for v in ("no-go", "look") if v in verdicts), "go")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the two tests with their arguments."""
    tests = parser.add_subparsers(metavar="TEST", required=True)
    for name, what in (
        ("pose", "the errors of the pad's position and heading on marked places"),
        ("gimbal", "how the gimbal centres the pad, and the errors while it turns"),
    ):
        sub = tests.add_parser(
            name,
            help=what,
            description=f"Measure {what}. The vehicle stands level and disarmed. With "
            "camera.driver sim all of it is simulated.",
            epilog=f"example: landerd bench-test {name} -c landerd.yaml --height 1.52 --mark 2,0 "
            "--mark 3,1 -o bench.csv",
        )
        _add_options(sub)
        sub.set_defaults(test=name)


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--mark",
        type=_mark,
        action="append",
        required=True,
        metavar="AHEAD,RIGHT",
        help="place of the landing point on the floor, from the point below the camera, m; "
        "give several",
    )
    parser.add_argument(
        "--height",
        type=metres(0.2, 30.0),
        required=True,
        metavar="M",
        help="height of the camera above the pad",
    )
    parser.add_argument(
        "--pictures",
        type=whole_number(3),
        default=30,
        metavar="N",
        help="number of pictures at each mark (30)",
    )
    add_bench(parser, "FILE.csv", "write a table of what every picture showed")


def _mark(text: str) -> tuple[float, float]:
    """Return how far ahead and right a mark is, m; the type of --mark."""
    try:
        ahead, right = (float(part) for part in text.split(","))
    except ValueError:
        ahead = right = math.nan
    if not (abs(ahead) <= _FARTHEST_M and abs(right) <= _FARTHEST_M):
        raise argparse.ArgumentTypeError(
            f"found {text!r}, expected AHEAD,RIGHT in m, as 2,-0.5, each at most {_FARTHEST_M:g}"
        )
    return ahead, right


def run(args: argparse.Namespace) -> int:
    """Do the test; return 0, or 1 if the verdict is "no-go".

    Raises:
        InputError: an argument, the configuration or a file cannot be used.
    """
    loaded, overlay = load_with_saved(args)
    check_bench(args, loaded)
    config = loaded.config
    is_simulated = config.camera.driver == "sim"
    if args.test == "gimbal" and config.gimbal.driver == "fixed":
        raise InputError("gimbal.driver: fixed does not turn; landerd bench-test pose is for it")
    marks = [Mark(ahead, right, args.height) for ahead, right in args.mark]
    with refusing(CalibrationError, PadError, SetUpError):
        bench = _Bench(loaded, overlay, args, is_simulated=is_simulated)
    measure = _pose_rows if args.test == "pose" else _gimbal_rows
    run_it: Callable[[Coroutine[Any, Any, Any]], Any] = run_virtual if is_simulated else asyncio.run
    rows, pictures, refused = run_it(_all(bench, marks, measure))
    verdict = next((v for v in ("no-go", "look") if v in {r.verdict for r in rows}), "go")
    if refused:
        verdict = "no-go"
    if args.output is not None:
        write_text(args.output, pictures)
    if args.json:
        print_json(_as_json(verdict, rows, refused))
    else:
        print("\n".join(_table(rows)))
        for reason in refused:
            print(f"no-go: {reason}")
        print(_SAID[verdict])
        if args.output is not None:
            print(f"written: {args.output}")
    return 1 if verdict == "no-go" else 0


_SAID = {
    "go": "go: on to the next step",
    "look": "look: figures marked with ! make landings worse; docs/bench.md says what mends them",
    "no-go": "no-go: do not fly with this; docs/bench.md says what mends it",
}


class _Bench:
    """Makes a trial for each mark, with real or simulated devices.

    Attributes:
        loaded: the configuration.
        pictures: number of pictures at each mark.
        layout: the pad.
        camera: the calibration at the size of the pictures.
    """

    def __init__(
        self, loaded: Loaded, overlay: Path, args: argparse.Namespace, *, is_simulated: bool
    ) -> None:
        """Read the pad and the calibration, and make the devices unless they are simulated.

        Args:
            loaded: the configuration.
            overlay: file of saved parameters.
            args: of the command line.
            is_simulated: whether the devices are simulated.

        Raises:
            CalibrationError: the calibration cannot be used.
            PadError: the pad file cannot be used.
            SetUpError: the devices cannot be made.
        """
        self.loaded, self.pictures = loaded, int(args.pictures)
        self.layout: PadLayout = load_pad(loaded.config.pad.layout)
        self.camera: CameraModel = fitting_camera(loaded)
        self._with_autopilot = not args.without_autopilot
        self._devices = None if is_simulated else make_devices(loaded, overlay)
        self._worker = None if is_simulated else Worker("vision")
        self._seed = 0

    @asynccontextmanager
    async def trial(self, mark: Mark) -> AsyncIterator[MarkTrial]:
        """Ask the user to lay the pad on a mark, and yield the trial there.

        With simulated devices nobody is asked.
        """
        if self._devices is not None:
            await ask(_NEXT.format(mark=_name(mark)))
            yield self._trial(self._devices)
            return
        from landerd.simulation.standing import standing

        async with standing(self.loaded, mark.place, self._seed) as devices:
            yield self._trial(devices)

    def _trial(self, devices: Devices) -> MarkTrial:
        options = self.loaded.options.get(f"gimbal.{self.loaded.config.gimbal.driver}")
        measured = not isinstance(options, GimbalOptions) or (
            options.traits.feedback is Feedback.MEASURED
        )
        vision = Vision(self.layout, self.camera, self.loaded.config.vision)
        return MarkTrial(
            self.loaded.config,
            self.layout,
            self.camera,
            devices,
            self._search(vision),
            is_measured=measured,
            with_autopilot=self._with_autopilot,
        )

    def _search(self, vision: Vision) -> Search:
        """Return a function that searches a picture, on real devices in a thread."""

        async def search(frame: Frame, prior: Prior) -> Sightings:
            call = partial(vision.process, frame, prior)
            if self._worker is None:
                await asyncio.sleep(0.0)
                return call()
            return await self._worker.run(call, _SEARCH_S)

        return search


_COLUMNS = (
    "mark",
    "time_s",
    "ahead_m",
    "right_m",
    "down_m",
    "heading_deg",
    "off_middle_deg",
    "sigma_m",
)
_Measure = Callable[[_Bench, Mark, MarkTrial], Coroutine[Any, Any, tuple[list[_Row], list[Seen]]]]


async def _all(
    bench: _Bench, marks: Sequence[Mark], measure: _Measure
) -> tuple[list[_Row], str, list[str]]:
    """Measure at all marks.

    Args:
        bench: makes the trials.
        marks: where the pad is laid.
        measure: returns the rows of one mark, and what its pictures showed.

    Returns:
        The rows, what the pictures showed as CSV, and a text for each mark without a result.
    """
    rows: list[_Row] = []
    refused: list[str] = []
    file = io.StringIO()
    table = csv.writer(file)
    table.writerow(_COLUMNS)
    for mark in marks:
        try:
            async with bench.trial(mark) as trial:
                found, seen = await measure(bench, mark, trial)
        except (DeviceLost, Refused) as e:
            refused.append(f"{_name(mark)}: {e}")
            continue
        except JobHangs:
            refused.append(f"{_name(mark)}: the search of a picture hangs")
            continue
        tell(f"{_name(mark)}: {len(seen)} pictures")
        rows += found
        table.writerows(_cells(mark, each) for each in seen)
    return rows, file.getvalue(), refused


def _cells(mark: Mark, seen: Seen) -> list[str]:
    """Return a row of the CSV file; cells without a value are empty."""
    values: list[float | None] = [seen.t, *(seen.place or (None, None, None))]
    values += [_degrees(seen.heading), _degrees(seen.off_middle), seen.sigma_m]
    texts = ["" if v is None or math.isnan(v) else f"{v:.4f}" for v in values]
    return [_name(mark), *texts]


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else math.degrees(angle)


async def _pose_rows(bench: _Bench, mark: Mark, trial: MarkTrial) -> tuple[list[_Row], list[Seen]]:
    """Measure the errors of the pad's pose on one mark; return their row and the pictures.

    The limits of the direction's error are from the error of the gimbal that the pad filter
    assumes. Those of the heading's error are from the part of the allowed heading error that is
    left for errors of gimbal and mounting.
    """
    seen = await trial.at_rest(bench.pictures)
    found = pose_errors(mark, seen)
    config = bench.loaded.config
    gimbal_deg = max(0.5, config.estimation.gimbal_sigma_deg)
    descent = config.guidance.descent
    heading = None if found.heading is None else abs(math.degrees(found.heading))
    figures = (
        _Figure("missed", 100.0 * (1.0 - found.found), 10.0, 50.0, "%"),
        _Figure("range", 100.0 * abs(found.range_share), 2.0, 4.0, "%"),
        _Figure("angle", math.degrees(found.direction), 2.0 * gimbal_deg, 4.0 * gimbal_deg, "deg"),
        _Figure(
            "heading",
            heading,
            MAX_HEADING_DEG - descent.realign_deg,
            MAX_HEADING_DEG - descent.align_deg,
            "deg",
        ),
        _Figure("scatter", 100.0 * found.scatter_m / math.hypot(*mark.place), 1.0, 3.0, "%"),
    )
    return [_Row(_name(mark), figures)], seen


async def _gimbal_rows(
    bench: _Bench, mark: Mark, trial: MarkTrial
) -> tuple[list[_Row], list[Seen]]:
    """Measure how the gimbal turns to the pad on one mark; return the rows and the pictures.

    The gimbal is turned aside several times and let turn back to the pad; each time is a row.

    Raises:
        Refused: the gimbal cannot be turned aside there.
    """
    rest, swings = await trial.swings(bench.pictures)
    if not swings:
        raise Refused("the gimbal cannot be turned aside: its limits, or a pad too large in view")
    gimbal_deg = max(0.5, bench.loaded.config.estimation.gimbal_sigma_deg)
    rows, seen = [], list(rest)
    for swing in swings:
        found = swing_errors(rest, swing)
        centred = math.inf if found.centred_s is None else found.centred_s
        figures = (
            _Figure("centred", centred, 1.0, 2.0, "s"),
            _Figure("off", math.degrees(found.rest), 6.0, 12.0, "deg"),
            _Figure("missed", 100.0 * (1.0 - found.found), 10.0, 50.0, "%"),
            _Figure(
                "turning", math.degrees(found.direction), 2.0 * gimbal_deg, 4.0 * gimbal_deg, "deg"
            ),
        )
        rows.append(_Row(f"{_name(mark)} {swing.axis} {math.degrees(swing.step):+.0f}", figures))
        seen += swing.seen
    return rows, seen


# ---- output ------------------------------------------------------------------------------------


def _name(mark: Mark) -> str:
    return f"{mark.ahead:g},{mark.right:g}"


def _table(rows: Sequence[_Row]) -> list[str]:
    """Return the lines of a table of the rows, with the limits below."""
    if not rows:
        return []
    names = [f"{figure.name} {figure.unit}" for figure in rows[0].figures]
    wide = max(4, *(len(row.what) for row in rows))
    lines = ["  ".join([f"{'mark':<{wide}}", *(f"{name:>11}" for name in names)])]
    for row in rows:
        cells = [f"{_shown(f)}{'' if f.verdict == 'go' else '!':1}" for f in row.figures]
        lines.append("  ".join([f"{row.what:<{wide}}", *(f"{c:>11}" for c in cells), row.verdict]))
    limits = [f"{f.go:g} / {f.no_go:g} " for f in rows[0].figures]
    return [*lines, "  ".join([f"{'at most':<{wide}}", *(f"{text:>11}" for text in limits)])]


def _shown(figure: _Figure) -> str:
    return "-" if figure.value is None else f"{figure.value:.2f}"


def _as_json(verdict: str, rows: Sequence[_Row], refused: Sequence[str]) -> dict[str, Any]:
    """Return the object that `--json` prints."""
    return {
        "verdict": verdict,
        "refused": list(refused),
        "rows": [
            {
                "mark": row.what,
                "verdict": row.verdict,
                **{f"{f.name}_{_UNITS[f.unit]}": _finite(f.value) for f in row.figures},
            }
            for row in rows
        ],
    }


_UNITS = {"%": "percent", "deg": "deg", "s": "s"}


def _finite(value: float | None) -> float | None:
    """Return a value for JSON, rounded; NaN and infinity become None."""
    return round(value, 3) if value is not None and math.isfinite(value) else None
