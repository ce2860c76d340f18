"""Any command line ends with 0, 1 or 2, and never with a traceback."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from landerd import cli
from tests.fuzz.budget import examples

COMMANDS = ["sim", "detect", "calibrate", "campaign", "replay", "report", "dry-run", "check"]
WORDS = st.sampled_from(
    [
        *("camera", "gimbal", "stationary", "no-such-scenario", "guidance", "no-such-campaign"),
        *("--seed", "--set", "--json", "--camera", "--pad", "--video", "--telemetry", "--log"),
        *("-c", "-o", "--runs", "--jobs", "--size", "--square", "--gimbal", "--at", "--keep"),
        *("nowhere/some.yaml", "nowhere/some.mcap", "nowhere/out.html", "9x6", "0", "-1", "nan"),
        *("sim.pad.speed_mps=x", "sim.faults=[{}]", "=", "a.b=", "", "%s", "\u00e9", "-"),
    ]
)


@examples(60)
@given(command=st.sampled_from(COMMANDS), words=st.lists(WORDS, max_size=7))
def test_a_random_command_line_is_refused_in_lines_and_not_with_a_traceback(
    command: str,
    words: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    # What could be flown or opened is asked for with a setting that nobody can read.
    arguments = [command, *words, "--set", "no.such.key=1"]
    try:
        code = cli.main(arguments)
    except SystemExit as e:
        code = e.code if isinstance(e.code, int) else 1
    told = capsys.readouterr().err
    assert code in (0, 1, 2)
    assert "Traceback" not in told
    assert code != 2 or told.strip()
