"""Runs `landerd dry-run` on other people's flight logs, and prints a table of the outcomes.

    python -m bench.dry_runs FOLDER... [--sample 60] [--seed 1] [--verbose]

Each .bin and .tlog file in the folders is played once, in a process of its own, with few drawn
pictures. It must either run, or be refused with one line that says what it lacks. A Python
traceback, more than one line, or no line at all is a defect, and the exit code is then 1. Below the
table stand the remarks on logs that ran, without their figures.
"""

import argparse
import json
import random
import re
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

LONGEST_S = 300.0  # longest time for a log
PICTURES_HZ = 4.0  # with fewer, pictures would be too old for set-points to follow them
REFUSED = 2  # exit code of `landerd dry-run` for a log that it refuses


def outcome(log: Path) -> tuple[str, str, list[str]]:
    """Play a log; return the kind of outcome (defects in capitals), its text, and remarks."""
    command = [sys.executable, "-m", "landerd", "dry-run", "--telemetry", str(log)]
    try:
        done = subprocess.run(
            [*command, "--fps", f"{PICTURES_HZ}", "--json"],
            capture_output=True,
            text=True,
            check=False,
            timeout=LONGEST_S,
        )
    except subprocess.TimeoutExpired:
        return "NOT DONE IN TIME", f"{LONGEST_S:.0f} s", []
    said = done.stderr.strip().splitlines()
    if "Traceback" in done.stderr:
        return "TRACEBACK", said[-1], []
    if done.returncode == REFUSED and len(said) == 1:
        return "refused", said[0].split(str(log))[-1].lstrip(": "), []
    if done.returncode != 0 or not done.stdout:
        return "UNCLEAR", f"exit code {done.returncode}, {len(said)} lines: {said[-1:]}", []
    result = json.loads(done.stdout)
    ended = result["outcome"] or "the recording ends before the landing does"
    if not result["setpoints"]:
        ended = f"no set-point, pad seen in {result['frames_with_pad']} of {result['frames']}"
    return "ran", ended, result["remarks"]


def kind(said: str) -> str:
    """Return a line with figures and directions replaced, so that similar lines are equal."""
    sides = re.sub(r"\b(north|south|east|west|above|below)\b", "there", said)
    return re.sub(r"[\d.]+", "N", sides)


def main() -> None:
    """Print the table and, if asked for, a line for each log; exit with 1 after a defect."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--sample", type=int, metavar="N", help="so many of them (all)")
    parser.add_argument("--seed", type=int, default=1, help="of the choice (1)")
    parser.add_argument("--verbose", action="store_true", help="a line each")
    args = parser.parse_args()
    logs = sorted(
        path
        for folder in args.folders
        for path in folder.rglob("*")
        if path.suffix.lower() in {".bin", ".tlog"} and path.stat().st_size
    )
    if args.sample is not None and args.sample < len(logs):
        logs = sorted(random.Random(args.seed).sample(logs, args.sample))
    ends: Counter[str] = Counter()
    lines: Counter[tuple[str, str]] = Counter()
    remarks: Counter[str] = Counter()
    for log in logs:
        began = time.monotonic()
        end, said, remarked = outcome(log)
        ends[end] += 1
        lines[end, kind(said)] += 1
        remarks.update({kind(remark) for remark in remarked})
        if args.verbose:
            print(f"{end:18} {time.monotonic() - began:5.1f} s  {log.name}: {said}", flush=True)
    print(f"{len(logs)} logs: " + ", ".join(f"{n} {end}" for end, n in ends.most_common()))
    for (end, said), n in lines.most_common():
        print(f"{n:5}  {end}: {said}")
    print("remarks")
    for remark, n in remarks.most_common():
        print(f"{n:5}  {remark}")
    sys.exit(any(end.isupper() for end in ends))


if __name__ == "__main__":
    main()
