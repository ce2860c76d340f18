import json
import math
import shlex
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from landerd.campaigns.journal import Journal, Plan, Sitting, read_kept
from landerd.campaigns.plan import Campaign, load_campaigns
from landerd.campaigns.pool import Run
from landerd.cli import main
from tests.campaigns.landings import landing

SITTING = Sitting("2026-01-02 03:04 UTC", "0.1.0 (abc1234)")


def path(flight: int) -> dict[str, list[float]]:
    """Return a flight path of 20 m to the pad, which is seen in every other sample."""
    steps = range(40)
    columns: dict[str, Any] = {key: [0.0] * 40 for key in ("east", "pad_north", "pad_east")}
    columns |= {"t": [0.3 * i for i in steps], "north": [0.5 * i - 20.0 - flight for i in steps]}
    columns |= {"up": [10.0 - 0.25 * i for i in steps]}
    columns |= {"heading_error_deg": [90.0 * math.exp(-0.2 * i) for i in steps]}
    for axis in (*"xyz", "ahead", "right", "below"):
        columns[axis] = [1.0 / (1 + i) if i % 2 else None for i in steps]
    return columns


def poses(seed: int) -> dict[str, Any]:
    pictures = []
    for i in range(40):
        d = 1.0 + 0.45 * i
        error = [0.001 * d * seed, 0.0, 0.002 * d]
        tag = {"distance_m": d, "error_m": error, "yaw_error_rad": 0.01 * (i % 3)}
        ring = {**tag, "yaw_error_rad": None}
        markers = {"whycon": ring, "whycode": ring, "apriltag": tag}
        flipped = {"flipped": False, "flipped_alone": i % 9 == 0}
        pictures.append({"distance_m": d, "markers": markers, **flipped})
    return {"seed": seed, "poses": pictures}


def keep(folder: Path, name: str, runs: int = 3, command: tuple[str, ...] = ()) -> Path:
    """Write the file of a campaign whose landings all succeed but the last."""
    file = folder / f"{name}.jsonl"
    campaigns = load_campaigns(name)
    with Journal(file, Plan("of " + name, campaigns, command), SITTING) as journal:
        for campaign in campaigns.values():
            for row in campaign.all_rows:
                for seed in range(1, runs + 1):
                    error_m = 0.01 * seed
                    flown = landing(row.name, seed, touchdown_error_m=error_m, path=path(seed))
                    result = poses(seed) if row.poses else flown
                    journal.keep(Run(row.name, seed, result))
    return file


class Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.heads: list[str] = []
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.heads += [v for k, v in attrs if k == "data-head" and v]
        self.links += [v for k, v in attrs if k in ("src", "href", "xlink:href") and v]


@pytest.mark.parametrize(
    ("name", "drawings"),
    [
        ("gimbal", 2),
        ("whycon-pose", 1),
        ("whycode-orientation", 1),
        ("apriltag-pose", 1),
        ("apriltag-yaw", 1),
        ("tune-ne", 3),
        ("yaw", 4),
        ("linear", 3),
        ("radial", 6),
        ("moving", 4),
    ],
)
def test_a_thesis_campaign_is_a_page_with_its_figures(
    name: str, drawings: int, tmp_path: Path
) -> None:
    output = tmp_path / "report.html"
    assert main(["report", str(keep(tmp_path, name, runs=2)), "-o", str(output)]) == 0
    text = output.read_text()
    page = Page(text)
    assert page.tags.count("svg") == drawings
    assert all(link.startswith(("data:", "#")) for link in page.links)
    (campaign,) = load_campaigns(name).values()
    assert campaign.title is not None
    assert campaign.title.replace("'", "&#x27;") in text
    for number in campaign.figures.values():
        assert f"Thesis: figure {number}." in text or f"Thesis: figures {number}." in text
    assert "landerd 0.1.0 (abc1234)" in text
    assert page.heads  # for phones, where each line of a table is a card


def test_results_are_shown_beside_those_of_the_thesis(tmp_path: Path) -> None:
    output = tmp_path / "results.md"
    assert main(["report", str(keep(tmp_path, "linear")), "-o", str(output)]) == 0
    (head, improved) = (
        [cell.strip() for cell in line.split("|")]
        for line in output.read_text().splitlines()
        if line.startswith(("| scenario", "| thesis, improved"))
    )
    row = dict(zip(head, improved, strict=True))
    assert row["thesis s"] == "35.6"
    assert row["time s"] == "18.0 ±0.0"
    assert (row["landed"], row["95 %"]) == ("3/3", "44-100 %")
    assert "2026-01-02, landerd 0.1.0 (abc1234)" in output.read_text()


def test_the_page_has_the_commands_that_repeat_the_worst_flights(tmp_path: Path) -> None:
    output = tmp_path / "results.md"
    file = keep(tmp_path, "radial", command=("--set", "sim.sight=modelled"))
    with file.open("a") as kept:
        (campaign,) = load_campaigns("radial").values()
        name = campaign.all_rows[0].name
        lost = landing(name, 9, landed=False, outcome="handed_back", touchdown_error_m=None)
        kept.write(json.dumps({"scenario": name, "seed": 9, "result": lost}) + "\n")
    assert main(["report", str(file), "-o", str(output)]) == 0
    lines = output.read_text().splitlines()
    commands = [line for line in lines if line.startswith("landerd sim")]
    assert len(commands) == 5
    first = shlex.split(commands[0])
    assert first[2:5] == ["radial", "--seed", "9"]
    assert first[-2:] == ["--set", "sim.sight=modelled"]
    assert "guidance.pid.up={kp: 0.6, ki: 0.0, kd: 0.5}" in first
    assert "not landed, handed_back" in lines[lines.index(commands[0]) - 1]
    assert [shlex.split(c)[4] for c in commands[1:]] == ["3", "3", "3", "2"]  # the farthest off


def test_files_of_all_kinds_become_one_page_of_results(tmp_path: Path) -> None:
    old = tmp_path / "effects.jsonl"  # as kept before files said what they hold
    old.write_text('{"settings": "1"}\n')
    with old.open("a") as kept:
        for value, landed in (("0.5", True), ("1.0", False)):
            name = f"stationary --set 'sim.render.glare={value}'"
            run = {"scenario": name, "seed": 1, "result": landing(name, 1, landed=landed)}
            kept.write(json.dumps(run) + "\n")
    sitl = tmp_path / "sitl.jsonl"
    flown = [landing("moving-5", 1, flown=SITTING._asdict()) for _ in range(2)]
    sitl.write_text("".join(json.dumps(result) + "\n" for result in flown))
    vision = tmp_path / "vision.txt"
    vision.write_text("== bench/vision_ring.py\n 5.0 m    0 deg  100 %\n")
    output = tmp_path / "results.md"
    command = ["report", *map(str, (old, sitl, vision)), "-o", str(output)]
    assert main(command) == 0
    text = output.read_text()
    assert "`landerd report effects.jsonl sitl.jsonl vision.txt -o results.md`" in text
    assert "| **render.glare** | **1.0** | **0/1** |" in text
    assert "2 runs, 2026-01-02, landerd 0.1.0 (abc1234)." in text
    assert "| moving-5 | 2/2 |" in text
    assert "### bench/vision_ring.py\n\n```\n 5.0 m    0 deg  100 %\n```" in text
    assert main(command) == 0
    assert output.read_text() == text  # the same files, the same page


@pytest.mark.parametrize("text", ["", "mine\n", '{"campaign": "thesis"}\n', '{"settings": "1"}\n'])
def test_a_file_of_another_kind_is_refused_in_one_line(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.jsonl"
    other.write_text(text)
    assert main(["report", str(other), "-o", str(tmp_path / "r.html")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{other}: ")
    assert not (tmp_path / "r.html").exists()


def test_a_file_of_runs_holds_its_campaigns_and_sittings(tmp_path: Path) -> None:
    kept = read_kept(keep(tmp_path, "wind", runs=1))
    assert kept.plan.campaigns == load_campaigns("wind")
    assert kept.sittings == (SITTING,)
    campaign = Campaign.model_validate_json(kept.plan.campaigns["wind"].model_dump_json())
    assert campaign == kept.plan.campaigns["wind"]


def test_tables_that_are_no_text_are_refused_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "vision.txt").write_bytes(b"\xff\xfe")
    for name, reason in (("vision.txt", "not text"), ("none.txt", "No such file or directory")):
        assert main(["report", str(tmp_path / name), "-o", str(tmp_path / "a.md")]) == 2
        assert f"{name}: cannot be read: {reason}" in capsys.readouterr().err
