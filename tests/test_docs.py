"""README and docs: links lead somewhere, the site builds, and commands run as they are printed."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from landerd.camera_model import CameraModel
from landerd.cli import _parser, main
from landerd.simulation import flight
from tests.calibration.boards import SQUARE_M, charuco, chessboard, good_views, shoot
from tests.quick_clock import run_quickly
from tests.recordings import write_bin, write_video
from tests.simulated import ABOVE, AS_FOUND, SEEN

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
_FENCE = re.compile(r"^\s*```.*?^\s*```", re.MULTILINE | re.DOTALL)
_SHELL = re.compile(r"^\s*```sh\n(.*?)^\s*```", re.MULTILINE | re.DOTALL)


# ---- links -------------------------------------------------------------------------------------


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings as GitHub makes them."""
    text = _FENCE.sub("", page.read_text("utf-8"))
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_to_files_and_headings_that_are_there(page: Path) -> None:
    dead = []
    for link in _LINK.findall(_FENCE.sub("", page.read_text("utf-8"))):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            dead.append(link)
    assert dead == []


def test_every_page_can_be_reached_from_the_site_and_on_github() -> None:
    index = (ROOT / "docs" / "index.rst").read_text("utf-8").split()
    readme = (ROOT / "README.md").read_text("utf-8")
    for page in PAGES[1:]:
        assert page.stem in index
        assert f"](docs/{page.name})" in readme


@pytest.mark.long
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="the extra docs is not installed: make sets it up")
    build = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet"]
    done = subprocess.run(
        [*build, ROOT / "docs", tmp_path / "site"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "site" / "wiring-navio2.svg").exists() or any(
        tmp_path.rglob("wiring-navio2.svg")
    )


def test_no_text_tells_to_install_landerd_from_a_package_index() -> None:
    """The name is not ours there: a stranger's package must not come onto a drone."""
    sources = [p for room in ("landerd", "hw") for p in (ROOT / room).rglob("*.py")]
    named = re.compile(r"""pip install\s+['"]?landerd(?![-/\w])""")
    assert [p.name for p in (*PAGES, *sources) if named.search(p.read_text("utf-8"))] == []


# ---- commands ----------------------------------------------------------------------------------

# Commands that need what a test has not, and are only read as the command line reads them; what
# they do is tested elsewhere.
ONLY_READ = (
    (r"^landerd check -c /etc/", "a real vehicle's links: tests/commands/test_check.py"),
    (r"^landerd calibrate gimbal", "a real gimbal: tests/commands/test_calibrate_gimbal.py"),
    (r"^landerd campaign ", "minutes of flights: tests/commands/test_campaign.py has short ones"),
    (r"calibrate camera /dev/video0", "a camera, which the kernel has in tests/devices"),
)


def commands(page: Path) -> list[str]:
    """Return the commands of landerd that a page shows to be typed, without remarks."""
    found = []
    for block in _SHELL.findall(page.read_text("utf-8")):
        joined = re.sub(r"(?:\\|(?<=\},))\n\s*", " ", block)  # lines that go on
        for line in joined.splitlines():
            command = re.sub(r"\s+#.*$", "", line).strip()
            command = re.sub(r"^sudo (python3 (-m )?(\S+\.whl/)?)?", "", command)
            found += [c for c in [command.replace(".venv/bin/", "")] if c.startswith("landerd ")]
    return found


def is_only_read(command: str) -> bool:
    return any(re.search(pattern, command) for pattern, _ in ONLY_READ)


SHOWN = {name: commands(page) for name, page in zip(NAMES, PAGES, strict=True)}
RUN = {name: [c for c in shown if not is_only_read(c)] for name, shown in SHOWN.items()}


def lighter(arguments: list[str]) -> list[str]:
    """Let flights begin just over the pad, one that is recorded with pictures; and draw few.

    What would be done to this computer is only said, and on the bench stands a simulated vehicle.
    """
    match arguments:
        case ["install" | "uninstall", *_]:
            return [*arguments, "--dry-run"]
        case ["calibrate", "camera", "photos/", "--board", "charuco", *_]:
            return [w.replace("photos/", "charuco_photos/") for w in arguments]
        case ["bench-test", *_]:
            own = [w.replace("/etc/landerd/landerd.yaml", "config/default.yaml") for w in arguments]
            return [*own, "--pictures", "3", "--set", "sim.camera.fps=10"]
        case ["sim", scenario, *_]:
            held = ("sim.autopilot.hold_s=3",)
            low = held if scenario == "hold" else ("sim.start.altitude_m=1.6",)
            seen = (SEEN, "sim.camera.fps=12") if "--log" in arguments else ()
            faulty = (AS_FOUND,) if any("sim.faults" in w for w in arguments) else ()
            settings = (*ABOVE, *low, *seen, *faulty)
            return [*arguments, *(word for setting in settings for word in ("--set", setting))]
        case ["dry-run", *_]:
            return [*arguments, "--fps", "1"]
    return arguments


LENS = CameraModel(320, 240, 265.0, 264.0, 161.0, 118.0, (-0.12, 0.05, 0.001, -0.002, 0.0))
RECORDED = "00001-20260614-153012.mcap"  # by the service
THEIR_OWN = {"config", "docs", "photos", "programs", "flight.mcap", "my-pad.yaml", RECORDED}
THEIR_OWN |= {"flight.bin", "flight.mp4", "my.yaml", "charuco_photos"}


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of pictures of the chessboard that the pages speak of."""
    folder = tmp_path_factory.mktemp("photos")
    shoot(folder, LENS, chessboard(9, 6), good_views(LENS, 10 * SQUARE_M, 7 * SQUARE_M))
    return folder


@pytest.fixture(scope="module")
def charuco_photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of pictures of the ChArUco board, nearer than its whole fits in."""
    folder = tmp_path_factory.mktemp("charuco")
    lens = LENS.scaled(480, 360)  # its markers are small
    views = good_views(lens, 8 * SQUARE_M, 11 * SQUARE_M)
    shoot(
        folder,
        lens,
        charuco(8, 11),
        [replace(p, x=1.3 * p.x, y=1.3 * p.y, z=0.8 * p.z) for p in views],
    )
    return folder


@pytest.fixture
def somewhere(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Return a folder like a checkout, in which a user has what the pages speak of."""
    for folder in ("config", "docs"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    shutil.copy(ROOT / "tests" / "golden" / "landing.mcap", tmp_path / "flight.mcap")
    shutil.copy(ROOT / "config" / "pads" / "nested.yaml", tmp_path / "my-pad.yaml")
    shutil.copy(ROOT / "tests" / "golden" / "landing.mcap", tmp_path / RECORDED)
    shutil.copy(ROOT / "config" / "default.yaml", tmp_path / "my.yaml")
    if "logs.md" in request.node.name:
        write_bin(tmp_path / "flight.bin")
        write_video(tmp_path / "flight.mp4", tmp_path / "flight.bin", (0.0, -90.0))
    if "cameras.md" in request.node.name:  # a second for every picture
        for board in ("photos", "charuco_photos"):
            (tmp_path / board).symlink_to(request.getfixturevalue(board))
    landerd = tmp_path / "programs" / "landerd"
    landerd.parent.mkdir()
    landerd.write_text("""#!/bin/sh\nprintf '%s\\037' "$@" >>"$0".typed; echo >>"$0".typed\n""")
    landerd.chmod(0o755)
    return tmp_path


def as_typed(command: str, somewhere: Path) -> list[list[str]]:
    """Let a shell read a line; return the arguments of each landerd that it would start."""
    programs = somewhere / "programs"
    path = f"{programs}:{os.environ['PATH']}"
    env = {**os.environ, "PATH": path}
    subprocess.run(["bash", "-c", command], cwd=somewhere, env=env, check=True)
    typed = programs / "landerd.typed"
    lines = typed.read_text("utf-8").splitlines()
    typed.unlink()
    return [line.split("\037")[:-1] for line in lines]


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name, shown in RUN.items() if shown])
def test_the_commands_of_a_page_run_as_printed(
    name: str,
    somewhere: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(somewhere)
    monkeypatch.setattr(flight, "run_realtime", run_quickly)
    # A computer that is too busy for real time never lands.
    monkeypatch.setattr(flight, "simulate", partial(flight.simulate, longest_s=25.0))
    for command in RUN[name]:
        for arguments in as_typed(command, somewhere):
            code = main(lighter(arguments))
            told = capsys.readouterr()
            # In real time a busy computer is a part of the flight, and here time is quicker.
            words = told.out + told.err
            flown = told.out.startswith("Landed") or "this computer was too busy" in words
            is_good = code == 0 or ("--realtime" in arguments and flown)
            assert is_good, f"{command}\n{told.out[-2000:]}{told.err[-2000:]}"
            assert "Traceback" not in told.err
    if (ROOT / ".git").exists():  # what a user has made stays out of the next commit
        made = {p.name for p in somewhere.iterdir()} - THEIR_OWN
        ignored = subprocess.run(
            ["git", "check-ignore", "--stdin"],
            cwd=ROOT,
            input="\n".join(sorted(made)),
            capture_output=True,
            text=True,
            check=False,
        )
        assert made == set(ignored.stdout.split())


@pytest.mark.parametrize("command", sorted({c for shown in SHOWN.values() for c in shown}))
def test_each_printed_command_is_accepted_by_the_command_line(command: str) -> None:
    for part in command.split(" && "):
        words = shlex.split(part)[1:]
        _parser(words).parse_args(words)
