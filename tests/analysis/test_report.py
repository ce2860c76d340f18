import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from landerd.analysis.flight import flight_of, sentences
from landerd.analysis.sighting_errors import judged
from landerd.cli import main
from landerd.config.models import LogSection
from landerd.flightlog.reader import read_log
from tests.recorded_flight import RecordedFlight, recorder

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def landing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a whole landing that once lost sight of the pad."""
    path = tmp_path_factory.mktemp("report") / "landing.mcap"
    options = LogSection(images="jpeg", every_nth=2, keep_free_mb=0.0)
    flight = RecordedFlight(recorder(path, options), np.full((48, 64), 90, np.uint8))
    flight.engaged().run(1.0)
    flight.visible = False
    flight.run(1.0)
    flight.visible = True
    flight.until_contact().run(6.0)
    flight.recorder.close()
    return path


class Page(HTMLParser):
    """What a browser would make of the page."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text = ""
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [v for k, v in attrs if k in ("src", "href", "xlink:href") and v]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_page_tells_the_landing_and_needs_nothing_else(landing: Path, tmp_path: Path) -> None:
    output = tmp_path / "report.html"
    assert main(["report", str(landing), "-o", str(output)]) == 0
    page = Page()
    page.feed(output.read_text())
    assert all(link.startswith(("data:", "#")) for link in page.links)
    assert page.tags.count("svg") == 6  # no battery in this flight
    assert page.tags.count("img") >= 4
    for title in ("What happened", "Way to the pad", "Pointing of the camera", "Velocities asked"):
        assert title in page.text
    assert "LANDED" in page.text


def test_the_reports_sentences_state_times_and_figures(landing: Path) -> None:
    told = sentences(flight_of(read_log(landing)))
    text = " ".join(told)
    assert "landerd lost sight of the pad once" in text
    assert "Outcome: landed" in text
    assert told[0] == "Simulated time, without a date, pad: ring and tag."
    assert re.search(r"by landerd's own estimate it then stood \d+ cm from the landing point", text)
    assert "its pictures are stamped" in text
    assert re.search(r"mean NIS of the sightings was [\d.]+, at most [\d.]+ \(3 is", text)
    # The flight's pictures come 50 ms after their exposure, and are searched within 12 ms.
    assert "Pictures were 50 ms old at the control step that could first fly on them" in text
    assert "38 ms camera and transport, 12 ms vision, 0 ms waiting" in text
    # Events are told in the order in which they happened.
    times = [float(t) for line in told[2:-3] for t in re.findall(r"([\d.]+) s[:.,]", line)[:1]]
    assert times == sorted(times)
    (approach,) = [t for t in told if "APPROACH (pad in sight)" in t and "At 1.1" in t]
    distance = re.search(r"([\d.]+) m from the pad and ([\d.]+) m over it", approach)
    assert distance is not None
    # The flight begins 0.85 m from the pad; its feet hang 1.8 m over it.
    assert float(distance[1]) == pytest.approx(0.9, abs=0.15)
    assert float(distance[2]) == pytest.approx(1.8, abs=0.2)


def test_sightings_are_judged_by_what_the_same_flight_saw_from_nearby(landing: Path) -> None:
    found = judged(flight_of(read_log(landing)))
    assert found is not None
    assert {each.kind for each in found} == {"apriltag"}
    assert max(each.error_m for each in found) < 0.05
    assert max(each.yaw_error_rad or 0.0 for each in found) < 0.03
    assert max(each.range_m for each in found) > 1.8


def test_a_cut_log_is_reported_as_far_as_it_goes(landing: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    data = landing.read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    output = tmp_path / "report.html"
    assert main(["report", str(landing), str(cut), "-o", str(output)]) == 0
    text = output.read_text()
    assert "recording was cut off" in text
    assert "the log ends before the landing does" in text
    assert "1 of 2 landed (95 %: 9-91 %)" in text
    assert "How true the sightings were" in text


def test_flights_of_one_name_are_told_apart_by_their_folders(
    landing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / landing.name
    other.symlink_to(landing)
    page = str(tmp_path / "r.html")
    assert main(["report", str(landing), str(other), "-o", page]) == 2
    assert capsys.readouterr().err == f"{other}: given twice, and would count twice\n"
    other.unlink()
    other.write_bytes(landing.read_bytes())
    assert main(["report", str(landing), str(other), "-o", page]) == 0
    text = Path(page).read_text()
    assert f">{landing}</td>" in text
    assert f">{other}</td>" in text


def test_a_file_that_is_no_log_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "no.mcap").touch()
    assert main(["report", str(tmp_path / "no.mcap"), "-o", str(tmp_path / "r.html")]) == 2
    assert capsys.readouterr().err == f"{tmp_path / 'no.mcap'}: empty, expected a flight log\n"


def test_files_of_other_suffixes_are_refused(
    landing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "pad.jpg"
    picture.touch()
    assert main(["report", str(picture), "-o", str(tmp_path / "r.html")]) == 2
    assert "pad.jpg: expected a flight log (.mcap)" in capsys.readouterr().err
    assert main(["report", str(landing), "-o", str(tmp_path / "r.pdf")]) == 2
    assert "r.pdf: expected a .html" in capsys.readouterr().err
    assert not (tmp_path / "r.pdf").exists()
