"""Breaks each safety rule in the code in turn and shows the test that notices (`make mutants`).

Every mutant is one replacement in a copy of the tree; its test must fail there. A mutant that
survives means that the rule is not guarded, and the command ends with exit code 1.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
COPIED = ("landerd", "hw", "config", "tests", "pyproject.toml")

PYTEST = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider")


class Mutant(NamedTuple):
    """One rule taken out."""

    rule: str
    file: str
    old: str
    new: str
    test: str  # in tests/test_safety.py


GATE = "landerd/guidance/gate.py"
SILENT, FLYING = "landerd/guidance/state_silent.py", "landerd/guidance/state_flying.py"
PAD, CONTEXT = "landerd/guidance/state_pad.py", "landerd/guidance/landing_context.py"
ORDERS, ESTIMATOR = "landerd/guidance/orders.py", "landerd/estimation/estimator.py"
LIMITS, PHASES = "landerd/guidance/limits.py", "landerd/guidance/phases.py"
TOUCHDOWN = "landerd/guidance/touchdown.py"

MUTANTS = [
    Mutant(
        "1a: flies on outside GUIDED",
        GATE,
        "if not beat.guided:",
        "if False:",
        "test_1a_set_points_end_when_the_pilot_leaves_guided",
    ),
    Mutant(
        "1a: flies on without heartbeats",
        GATE,
        "now - beat.t > self._freshness.heartbeat_s",
        "False",
        "test_1a_nothing_is_sent_without_heartbeats",
    ),
    Mutant(
        "1b: the switch does nothing",
        GATE,
        "if self._pulse_us <= self._threshold_us:",
        "if False:",
        "test_1b_a_closed_gate_gives_zeros_for_a_second_and_then_silence",
    ),
    Mutant(
        "1b: silent at once when the gate closes",
        SILENT,
        "step.now < self._until:",
        "False:",
        "test_1b_a_closed_gate_gives_zeros_for_a_second_and_then_silence",
    ),
    Mutant(
        "1b: never silent after the gate closed",
        SILENT,
        "step.now < self._until:",
        "True:",
        "test_1b_a_closed_gate_gives_zeros_for_a_second_and_then_silence",
    ),
    Mutant(
        "1b: silent at once when heartbeats end",
        GATE,
        "silent = Authority.SILENT if beat is None else Authority.RELEASED",
        "silent = Authority.SILENT",
        "test_1b_without_heartbeats_it_stops_before_it_is_silent",
    ),
    Mutant(
        "1b: stops on a pad that moves",
        CONTEXT,
        "return self._just_over_pad and self.over_fast_pad",
        "return False",
        "test_1b_a_gate_closed_just_over_a_moving_pad_does_not_stop_on_it",
    ),
    Mutant(
        "1b: released on the pad it does not stand level",
        PAD,
        "level or (released and touchdown.stands)",
        "not released and level",
        "test_1b_a_gate_closed_on_the_pad_leaves_the_vehicle_standing",
    ),
    Mutant(
        "2: sinks faster than the autopilot's timeout allows",
        "landerd/guidance/sink_rate.py",
        "return max(TOUCHES_AT_MPS, fastest)",
        "return 9.0",
        "test_2_landerd_may_die_at_any_height",
    ),
    Mutant(
        "2: sinks on to a pad that has stopped",
        PAD,
        "if clearance > 0.0 and self._misses(step.now, relative, pad.heading):",
        "if False:",
        "test_2_a_pad_that_stops_after_commit_is_waved_off",
    ),
    Mutant(
        "5: flies on frozen angles",
        "landerd/runtime/frozen.py",
        "return not self._may_repeat",
        "return False",
        "test_5_frozen_gimbal_angles_stop_the_landing",
    ),
    Mutant(
        "1b: flies on stale RC",
        GATE,
        "now - self._rc_t > self._freshness.rc_s",
        "False",
        "test_1b_stale_rc_closes_the_gate_but_does_not_latch",
    ),
    Mutant(
        "1c: hovers before it has seen the pad",
        SILENT,
        "if step.granted and context.sight(step) is not None:",
        "if step.granted:",
        "test_1c_landerd_is_silent_until_it_has_seen_the_pad",
    ),
    Mutant(
        "1d: turns on while the pad is out of sight",
        FLYING,
        "context.orders.fly(velocity, 0.0, may_descend=False)",
        "context.orders.fly(velocity, 0.3, may_descend=False)",
        "test_1d_out_of_sight_it_hovers_does_not_turn_says_so_and_hands_back",
    ),
    Mutant(
        "1d: stops once instead of streaming the hover",
        FLYING,
        "context.orders.fly(velocity, 0.0, may_descend=False)",
        "pass",
        "test_1d_out_of_sight_it_hovers_does_not_turn_says_so_and_hands_back",
    ),
    Mutant(
        "1: losing GUIDED does not latch",
        GATE,
        "(last.guided and not heartbeat.guided)",
        "False",
        "test_1_it_latches_until_the_switch_was_low[mode]",
    ),
    Mutant(
        "1: an arming does not wait for the switch",
        GATE,
        "self._latched = True  # as when just started",
        "self._latched = False",
        "test_1_it_latches_until_the_switch_was_low[disarm]",
    ),
    Mutant(
        "1: a restart of the autopilot does not latch",
        GATE,
        "self._rc_t = -math.inf\n        self._latched = True",
        "self._rc_t = -math.inf",
        "test_1_it_latches_until_the_switch_was_low[reboot]",
    ),
    Mutant(
        "2: descends without a young sighting",
        CONTEXT,
        "limit = self.options.lost.after_s - step.dt",
        "limit = 9.0",
        "test_2_no_descent_without_a_young_sighting",
    ),
    Mutant(
        "2: descends outside the region",
        PHASES,
        "return relative.distance + 2.0 * relative.sigma_m < radius",
        "return radius > 0.0",
        "test_2_no_descent_outside_the_region",
    ),
    Mutant(
        "2: descends with the heading off",
        PHASES,
        "return 0.0 if self._aligned else self._options.alignment_height_m + ALIGNMENT_MARGIN_M",
        "return 0.0",
        "test_2_no_descent_below_the_alignment_height_with_the_heading_off",
    ),
    Mutant(
        "2: commits too high",
        PHASES,
        "relative.height < self._options.commit_height_m",
        "relative.height < 1.0",
        "test_2_no_commitment_higher_than_the_commit_height",
    ),
    Mutant(
        "2: sinks blind for long after commit",
        TOUCHDOWN,
        "MAX_BLIND_S = 0.95",
        "MAX_BLIND_S = 9.0",
        "test_2_after_commit_it_sinks_blind_for_a_second_at_most",
    ),
    Mutant(
        "3: no limit of speed",
        LIMITS,
        "k = limits.speed_mps / speed if speed > limits.speed_mps else 1.0",
        "k = 1.0",
        "test_3_set_points_keep_the_limits_from_far_away",
    ),
    Mutant(
        "3: no limit of acceleration",
        LIMITS,
        "return min(wanted, acceleration)",
        "return wanted",
        "test_3_set_points_keep_the_limits_from_far_away",
    ),
    Mutant(
        "3: no limit of jerk",
        LIMITS,
        "k = max_change / size if size > max_change else 1.0",
        "k = 1.0",
        "test_3_set_points_keep_the_limits_from_far_away",
    ),
    Mutant(
        "3: no limit of the yaw rate",
        LIMITS,
        "rate = clamp(yaw_rate, -self._yaw_rate_limit, self._yaw_rate_limit)",
        "rate = yaw_rate",
        "test_2_no_descent_below_the_alignment_height_with_the_heading_off",
    ),
    Mutant(
        "3: set-points too seldom",
        "landerd/runtime/daemon.py",
        "period = 1.0 / self._config.control.rate_hz",
        "period = 0.1",
        "test_an_undisturbed_landing_breaks_no_rule_and_is_told",
    ),
    Mutant(
        "4: no descent ordered after contact",
        PAD,
        "orders.fly((north, east, self._touchdown.descent(0.0)), 0.0, may_descend=True)",
        "orders.fly((north, east, 0.0), 0.0, may_descend=True)",
        "test_an_undisturbed_landing_breaks_no_rule_and_is_told",
    ),
    Mutant(
        "4: stands level as soon as it touches",
        TOUCHDOWN,
        "waited > LEVEL_AFTER_S and now - self._still_since >= STILL_S",
        "waited > 0.0",
        "test_4_without_on_ground_it_keeps_pressing_and_tells_the_pilot",
    ),
    Mutant(
        "4: disarms before ON_GROUND",
        TOUCHDOWN,
        "if landed is not Landed.ON_GROUND or ",
        "if ",
        "test_4_without_on_ground_it_keeps_pressing_and_tells_the_pilot",
    ),
    Mutant(
        "4: never says that touch-down is not confirmed",
        TOUCHDOWN,
        "return late and landed is not Landed.ON_GROUND",
        "return False",
        "test_4_without_on_ground_it_keeps_pressing_and_tells_the_pilot",
    ),
    Mutant(
        "5: flies on a stale attitude",
        ESTIMATOR,
        "if poses.attitude.age(now) + self._clock_s > fresh.attitude_s:",
        "if False:",
        "test_5_stale_telemetry_is_not_flown_on[30-attitude is stale]",
    ),
    Mutant(
        "5: flies on a stale position",
        ESTIMATOR,
        "if poses.position.age(now) + self._clock_s > fresh.position_s:",
        "if False:",
        "test_5_stale_telemetry_is_not_flown_on[32-position is stale]",
    ),
    Mutant(
        "5: flies on stale gimbal angles",
        "landerd/estimation/camera_pose.py",
        "max_gap_s=fresh.gimbal_s",
        "max_gap_s=99.0",
        "test_5_a_gimbal_that_fails_stops_the_landing[GimbalFault.SILENT]",
    ),
    Mutant(
        "6: the pilot is told nothing",
        ORDERS,
        "self.commands.append(StatusText(severity, line))",
        "pass",
        "test_1d_out_of_sight_it_hovers_does_not_turn_says_so_and_hands_back",
    ),
]


def main() -> int:
    """Run all mutants whose rule contains the first argument; return the exit code."""
    wanted = sys.argv[1] if len(sys.argv) > 1 else ""
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, tree / name)
        for mutant in (m for m in MUTANTS if wanted in m.rule):
            noticed = _is_noticed(mutant, tree)
            survivors += not noticed
            print(f"{'noticed ' if noticed else 'SURVIVED'}  {mutant.rule:50}  {mutant.test}")
            sys.stdout.flush()
    print(f"{survivors} survived" if survivors else "every rule is guarded")
    return 1 if survivors else 0


def _is_noticed(mutant: Mutant, tree: Path) -> bool:
    path = tree / mutant.file
    sound = path.read_text(encoding="utf-8")
    if sound.count(mutant.old) != 1:
        raise SystemExit(f"{mutant.rule}: {mutant.old!r} is not once in {mutant.file}")
    path.write_text(sound.replace(mutant.old, mutant.new), encoding="utf-8")
    try:
        run = subprocess.run(
            [*PYTEST, f"tests/test_safety.py::{mutant.test}"],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        path.write_text(sound, encoding="utf-8")
    if run.returncode not in (0, 1):
        raise SystemExit(f"{mutant.rule}: the test did not run:\n{run.stdout}{run.stderr}")
    return run.returncode == 1


if __name__ == "__main__":
    sys.exit(main())
