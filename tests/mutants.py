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
    """A change of the code that disables one safety rule."""

    rule: str
    file: str
    old: str
    new: str
    test: str  # in tests/test_safety.py, or FILE::TEST in tests/


GATE = "landerd/guidance/gate.py"
SILENT, FLYING = "landerd/guidance/state_silent.py", "landerd/guidance/state_flying.py"
COMMITTED, ON_PAD = "landerd/guidance/state_committed.py", "landerd/guidance/state_on_pad.py"
LEAVING, CONTEXT = "landerd/guidance/state_leaving.py", "landerd/guidance/landing_context.py"
ORDERS, ESTIMATOR = "landerd/guidance/orders.py", "landerd/estimation/estimator.py"
ATTEMPTS, BELOW = "landerd/guidance/attempts.py", "landerd/guidance/pad_below.py"
LIMITS, PHASES = "landerd/guidance/limits.py", "landerd/guidance/phases.py"
TOUCHDOWN, LANDING = "landerd/guidance/touchdown.py", "landerd/guidance/landing.py"
TRACKING, CONTACT = "landerd/guidance/tracking_method.py", "landerd/guidance/contact.py"

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
        "now - beat.t + self._clock_s > self._freshness.heartbeat_s",
        "False",
        "test_1a_nothing_is_sent_without_heartbeats",
    ),
    Mutant(
        "1b: speeds up after a fast pad that was left long ago",
        LANDING,
        "            self._context.below.leave()\n",
        "            pass\n",
        "guidance/test_landing.py::"
        "test_metres_above_a_fast_pad_left_behind_the_switch_stops_it_at_once",
    ),
    Mutant(
        "1c: takes off from the pad to hold over it",
        CONTEXT,
        "waits = self.hold_asked if rests else self.rest.is_possible",
        "waits = not rests and self.rest.is_possible",
        "guidance/test_hold.py::test_a_vehicle_on_the_pad_does_not_take_off_to_hold",
    ),
    Mutant(
        "1b: is stopped for want of time just over a fast pad",
        FLYING,
        "context.attempts.takes_too_long(step.now) and not context.below.is_fast_and_close",
        "context.attempts.takes_too_long(step.now)",
        "guidance/test_landing.py::test_no_landing_is_given_back_just_over_a_fast_pad",
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
        "step.now < context.stops_until:",
        "False:",
        "test_1b_a_closed_gate_gives_zeros_for_a_second_and_then_silence",
    ),
    Mutant(
        "1b: never silent after the gate closed",
        SILENT,
        "step.now < context.stops_until:",
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
        BELOW,
        "return self._is_just_over and self.is_fast",
        "return False",
        "test_1b_a_gate_closed_just_over_a_moving_pad_does_not_stop_on_it",
    ),
    Mutant(
        "1b: released on the pad it does not stand level",
        ON_PAD,
        "if level:",
        "if level and not released:",
        "test_1b_a_gate_closed_on_the_pad_leaves_the_vehicle_standing",
    ),
    Mutant(
        "2: sinks faster than the autopilot's timeout allows",
        "landerd/guidance/sink_rate.py",
        "return max(TOUCHES_AT_MPS, fastest)",
        "return 9.0",
        "test_2_if_landerd_dies_at_any_height_the_vehicle_comes_down_gently",
    ),
    Mutant(
        "2: sinks on to a pad that has stopped",
        COMMITTED,
        "if in_air and self._misses(step.now, _of_foot(relative, vehicle), pad.heading):",
        "if False:",
        "test_2_a_pad_that_stops_after_commit_is_waved_off",
    ),
    Mutant(
        "5: flies on frozen angles",
        "landerd/runtime/frozen_input.py",
        "return self._is_restless and not self._is_coarse",
        "return False",
        "test_5_frozen_gimbal_angles_stop_the_landing",
    ),
    Mutant(
        "5: flies on pictures that arrive sooner than they can",
        "landerd/runtime/frame_times.py",
        "        return is_sooner",
        "        return False",
        "runtime/test_frame_times.py::test_frames_stamped_late_are_refused_at_once",
    ),
    Mutant(
        "5: flies on frozen pictures",
        "landerd/runtime/frozen_input.py",
        "return even < EVEN_SHARE * image.size",
        "return False",
        "simulation/test_sight.py::test_frozen_pictures_are_noticed",
    ),
    Mutant(
        "5: takes pictures that are blown out for frozen ones",
        "landerd/runtime/frozen_input.py",
        "return even < EVEN_SHARE * image.size",
        "return even >= 0",
        "runtime/test_frozen_input.py"
        "::test_pictures_that_are_all_white_or_black_are_new_ones_whatever_pixels_are_dead",
    ),
    Mutant(
        "1b: flies on stale RC",
        GATE,
        "now - self._rc_t + self._clock_s > self._freshness.rc_s",
        "False",
        "test_1b_stale_rc_closes_the_gate_but_does_not_latch",
    ),
    Mutant(
        "1c: hovers before it has seen the pad",
        CONTEXT,
        "if self.sight is None or sinks:",
        "if sinks:",
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
        "2: sinks on while the newest sighting shows the pad elsewhere",
        FLYING,
        "phases.may_descend(relative, off_m)",
        "phases.may_descend(relative)",
        "simulation/test_faults.py::test_it_does_not_sink_on_while_the_pad_is_seen_elsewhere",
    ),
    Mutant(
        "a pad that turns about itself and drives straight is trailed",
        "landerd/estimation/motion_filter.py",
        "turned = self.coupling * self.turn_rate * dt",
        "turned = self.turn_rate * dt",
        "estimation/test_pad_filter.py::test_a_pad_that_turns_about_itself_drives_straight_on",
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
        "limit = self.options.lost.after_s - min(step.dt, MAX_STEP_S)",
        "limit = 9.0",
        "test_2_no_descent_without_a_young_sighting",
    ),
    Mutant(
        "1d: a moment of stale attitude ends a descent",
        CONTEXT,
        "return is_seen and lately and self.attempts.outcome is None",
        "return False",
        "test_lander.py::test_moments_of_stale_attitude_break_off_no_descent_and_longer_ones_do",
    ),
    Mutant(
        "2: descends outside the region",
        PHASES,
        "return self.farthest_m(relative, off_m) < self.radius_m(relative)",
        "return self.radius_m(relative) > 0.0",
        "test_2_no_descent_outside_the_region",
    ),
    Mutant(
        "2: descends with the heading off",
        PHASES,
        "may_land = self._aligned and not self.leans",
        "may_land = True",
        "test_2_no_descent_below_the_alignment_height_with_the_heading_off",
    ),
    Mutant(
        "2: commits too high",
        PHASES,
        "and relative.height < self._options.commit_height_m",
        "and relative.height < 1.0",
        "guidance/test_phases.py::"
        "test_it_commits_only_aligned_over_the_pad_and_below_the_commit_height",
    ),
    Mutant(
        "2: sinks blind for long after commit",
        TOUCHDOWN,
        "MAX_BLIND_S = 0.97",
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
        ON_PAD,
        "orders.fly((north, east, down if descends else 0.0), 0.0, may_descend=descends)",
        "orders.fly((north, east, 0.0), 0.0, may_descend=True)",
        "test_an_undisturbed_landing_breaks_no_rule_and_is_told",
    ),
    Mutant(
        "4: stands level as soon as it touches",
        TOUCHDOWN,
        "stands and (released or self._has_stood_still(now))",
        "self._pressed_s(now) > 0.0",
        "test_4_without_on_ground_it_keeps_pressing_and_tells_the_pilot",
    ),
    Mutant(
        "4: disarms before ON_GROUND",
        TOUCHDOWN,
        "return touched and landed is Landed.ON_GROUND",
        "return touched",
        "test_4_without_on_ground_it_keeps_pressing_and_tells_the_pilot",
    ),
    Mutant(
        "4: never says that touch-down is not confirmed",
        TOUCHDOWN,
        "return not self.has_touched or landed is not Landed.ON_GROUND or self.is_refused(now)",
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
        "held_s=min(GIMBAL_HELD_S, fresh.gimbal_s)",
        "held_s=99.0",
        "test_5_a_gimbal_that_fails_stops_the_landing[GimbalFault.SILENT]",
    ),
    Mutant(
        "6: the pilot is told nothing",
        ORDERS,
        "self.commands.append(StatusText(severity, line))",
        "pass",
        "test_1d_out_of_sight_it_hovers_does_not_turn_says_so_and_hands_back",
    ),
    Mutant(
        "1b: told to stop it flies on",
        GATE,
        "if self._ending:",
        "if False:",
        "test_lander.py::test_told_to_shut_down_it_hovers_half_a_second_and_falls_silent_whatever_the_switch_does",
    ),
    Mutant(
        "1: no signal counts as the switch seen low",
        GATE,
        "if 0 < self._pulse_us <= self._threshold_us:",
        "if self._pulse_us <= self._threshold_us:",
        "guidance/test_gate.py::test_no_signal_closes_the_gate_but_is_not_the_switch_seen_low",
    ),
    Mutant(
        "1: a hand-back does not latch",
        LANDING,
        "        self._gate.latch()\n",
        "",
        "test_lander.py::test_with_the_pad_out_of_sight_it_holds_climbs_and_hands_back_and_says_so",
    ),
    Mutant(
        "1b: a clock that is set back keeps the switch away",
        "hw/autopilots/mavlink.py",
        "and boot_s > last_boot_s:",
        "and False:",
        "hw/autopilots/test_mavlink.py"
        "::test_a_clock_that_is_set_back_does_not_keep_the_pilots_switch_away",
    ),
    Mutant(
        "1b: the switch's old position overtakes its new one",
        GATE,
        "if rc.t < self._rc_t:",
        "if False:",
        "guidance/test_gate.py::test_messages_older_than_the_last_are_dropped",
    ),
    Mutant(
        "1: an old heartbeat overtakes a new one",
        GATE,
        "if last is not None and heartbeat.t < last.t:",
        "if False:",
        "guidance/test_gate.py::test_messages_older_than_the_last_are_dropped",
    ),
    Mutant(
        "1b: a wave-off does not climb",
        LIMITS,
        "self._at_once(north, east, -self._limits.climb_mps, dt)",
        "self._at_once(north, east, self._limits.climb_mps, dt)",
        "guidance/test_landing.py::test_committed_and_sight_is_lost_it_sinks_on_then_climbs_without_holding",
    ),
    Mutant(
        "1d: sinks to see more",
        "landerd/guidance/lost.py",
        "return (0.0, 0.0, -o.climb_mps), pilot_texts.CLIMBING",
        "return (0.0, 0.0, o.climb_mps), pilot_texts.CLIMBING",
        "guidance/test_lost.py::test_after_holding_it_climbs_straight_up_by_the_configured_height",
    ),
    Mutant(
        "1d: climbs anew with each loss of sight",
        "landerd/guidance/lost.py",
        "if now - self._stepped_t > RESUMES_S:",
        "if True:",
        "guidance/test_lost.py::test_a_pad_lost_again_and_again_does_not_take_it_ever_higher",
    ),
    Mutant(
        "1d: after a descent it does not climb again",
        "landerd/guidance/lost.py",
        "else max(self._lowest_down, down_m)",
        "else self._lowest_down",
        "guidance/test_lost.py::test_the_climb_of_losses_that_follow_one_another_is_from_the_lowest",
    ),
    Mutant(
        "2: sinks on while asked to hold",
        FLYING,
        "hold_m = o.hold.height_m if context.hold_asked else 0.0",
        "hold_m = 0.0",
        "guidance/test_hold.py::test_asked_in_the_descent_it_climbs_to_where_it_holds",
    ),
    Mutant(
        "2: descends to commit while asked to hold",
        PHASES,
        "descends = self._aligned and may_land",
        "descends = self._aligned",
        "guidance/test_hold.py::test_it_holds_over_the_pad_says_so_once_and_lands_when_the_switch_goes_up",
    ),
    Mutant(
        "2: touches down although asked to hold since commit",
        COMMITTED,
        "if self._asks_to_hold(step.now) and not self._touchdown.may_touch:",
        "if False:",
        "guidance/test_hold.py::test_committed_it_climbs_away_and_holds_and_that_is_no_failed_descent",
    ),
    Mutant(
        "1b: a switch that passes its middle asks for a hold",
        COMMITTED,
        "return now - self._hold_since >= HOLD_ASKED_S",
        "return asked",
        "guidance/test_landing.py::test_a_switch_that_passes_its_middle_releases_as_one_that_has_none",
    ),
    Mutant(
        "2: the middle of the switch means nothing",
        GATE,
        "return self._threshold_us < self._pulse_us <= self._land_threshold_us",
        "return False",
        "guidance/test_gate.py::test_between_its_ends_a_switch_of_three_positions_asks_to_hold",
    ),
    Mutant(
        "2: commits with an old sighting",
        PHASES,
        "blind_s = sighting_age + relative.height / BUDGET_SINK_RATE_MPS + CONTACT_S",
        "blind_s = sighting_age",
        "guidance/test_phases.py::test_the_higher_it_commits_the_younger_the_last_sighting_must_be",
    ),
    Mutant(
        "descent region: a vehicle that leaves it to the east sinks on",
        PHASES,
        "north * v_north + east * v_east",
        "north * v_north - east * v_east",
        "guidance/test_phases.py"
        "::test_a_vehicle_carried_out_of_the_region_stops_sinking_before_it_is_out",
    ),
    Mutant(
        "an error to the north-east counts less than one to the north",
        "landerd/geometry.py",
        "math.hypot(0.5 * (xx - yy), xy)",
        "abs(0.5 * (xx - yy))",
        "test_symmetry.py::test_a_flight_that_is_turned_and_moved_gets_the_same_orders",
    ),
    Mutant(
        "2: sinks on where sight is too old to commit",
        FLYING,
        "is_blind = phases.is_blind(relative, sight.age)",
        "is_blind = False",
        "guidance/test_landing.py::"
        "test_blind_below_the_commit_height_and_not_committed_it_sinks_no_farther",
    ),
    Mutant(
        "4: a contact that was none is believed for good",
        ON_PAD,
        "if now - self._clear_since >= MISSES_S or",
        "if",
        "guidance/test_landing.py::test_a_vehicle_that_a_gust_held_up_and_lifts_was_not_on_the_pad",
    ),
    Mutant(
        "4: a contact out of sight that was none is believed for good",
        ON_PAD,
        " or self._flies_unseen(now):",
        ":",
        "guidance/test_landing.py"
        "::test_a_vehicle_that_was_held_up_and_sinks_on_out_of_sight_was_not_on_the_pad",
    ),
    Mutant(
        "2: a pad that left the picture after commit",
        "landerd/estimation/inconsistency.py",
        "self.lasts_s = max(self.lasts_s, t - self._likely_t)",
        "pass",
        "simulation/test_faults.py::test_a_pad_that_jerks_out_of_the_picture_after_commit_is_not_sunk_onto",
    ),
    Mutant(
        "4: level without thrust while it rises",
        TOUCHDOWN,
        "if self._lifts(now, motion) and (self._level or not tips):",
        "if False:",
        "guidance/test_landing.py::test_levelled_as_its_thrust_lifted_it_flies_on_instead_of_falling",
    ),
    Mutant(
        "4: one that tips about an edge gets its thrust back",
        TOUCHDOWN,
        "self._lowest_down - motion.foot_down",
        "self._lowest_down - motion.feet_down",
        "guidance/test_landing.py::test_levelled_it_gets_no_thrust_back_as_it_tips_about_an_edge",
    ),
    Mutant(
        "4: levelled while it rises from the pad",
        TOUCHDOWN,
        "if self._lifts(now, motion) and (self._level or not tips):",
        "if self._lifts(now, motion) and self._level:",
        "guidance/test_touchdown.py"
        "::test_a_vehicle_that_rises_gently_as_its_thrust_comes_back_is_not_levelled_in_the_air",
    ),
    Mutant(
        "4: a heaving deck keeps it from being levelled",
        TOUCHDOWN,
        "LIFTS_MPS + deck_mps",
        "LIFTS_MPS",
        "guidance/test_touchdown.py"
        "::test_a_deck_that_heaves_carries_a_vehicle_up_and_it_is_levelled_all_the_same",
    ),
    Mutant(
        "2: a stop of a moment speeds a descent up",
        ORDERS,
        "down = min(down, max(0.0, sink_rate))",
        "pass",
        "guidance/test_orders.py::test_stopped_for_a_moment_it_goes_on_braking_its_descent",
    ),
    Mutant(
        "4: a deck that begins to heave after the touch keeps it from being levelled",
        TOUCHDOWN,
        "max(motion.fastest_heave, -motion.heave)",
        "motion.fastest_heave",
        "guidance/test_touchdown.py"
        "::test_a_deck_that_begins_to_heave_after_the_touch_carries_it_up_too",
    ),
    Mutant(
        "aim: a pad that stopped is not looked for behind",
        "landerd/guidance/aim.py",
        "SWEEP_LOW, SWEEP_HIGH = math.radians(-140.0), math.radians(-40.0)",
        "SWEEP_LOW, SWEEP_HIGH = math.radians(-75.0), math.radians(-40.0)",
        "guidance/test_aim.py::"
        "test_it_waits_at_idle_and_then_sweeps_over_what_lies_below_and_behind_and_back",
    ),
    Mutant(
        "2: commits to a bad touch-down",
        PHASES,
        "if self._commits(relative) and not unfit:",
        "if self._commits(relative):",
        "guidance/test_phases.py::test_it_does_not_commit_to_a_bad_touch_down_but_climbs_and_tries_again",
    ),
    Mutant(
        "2: commits on a plate whose slope makes its lean too much to stand with",
        PHASES,
        "self._lean = angle_between(unlagged, relative.normal)",
        "self._lean = angle_between(unlagged, (0.0, 0.0, 1.0))",
        "guidance/test_landing.py::test_the_lean_that_forbids_a_landing_is_relative_to_the_plate",
    ),
    Mutant(
        "3: flies away from the pad, north",
        TRACKING,
        "v[0] + k * north + self._integral[0],",
        "v[0] - k * north + self._integral[0],",
        "test_lander.py::test_it_lands_on_the_pad_and_disarms",
    ),
    Mutant(
        "3: flies away from the pad, east",
        TRACKING,
        "v[1] + k * east + self._integral[1],",
        "v[1] - k * east + self._integral[1],",
        "test_lander.py::test_it_lands_on_the_pad_and_disarms",
    ),
    Mutant(
        "3: turns the wrong way",
        TRACKING,
        "turn = math.copysign(_braking_speed(abs(error), self._yaw_kp, YAW_BRAKE), error)",
        "turn = math.copysign(_braking_speed(abs(error), self._yaw_kp, YAW_BRAKE), -error)",
        "guidance/test_tracking_method.py::test_it_turns_the_short_way_as_soon_as_it_looks_down_on_the_pad",
    ),
    Mutant(
        "3: a yaw rate that is wrong is not learned",
        TRACKING,
        "wanted = pad_turn_rate + turn + self._turn_integral",
        "wanted = pad_turn_rate + turn",
        "guidance/test_tracking_method.py::test_a_vehicle_that_turns_beside_its_order_still_comes_to_the_pads_heading",
    ),
    Mutant(
        "3: turns with a gain that the airframe's lag does not allow",
        TRACKING,
        "self._yaw_kp = min(options.tracking.yaw_kp, MAX_YAW_KP_LAG / YAW_LAG_S)",
        "self._yaw_kp = options.tracking.yaw_kp",
        "guidance/test_tracking_method.py::test_a_large_heading_gain_does_not_make_the_heading_swing",
    ),
    Mutant(
        "3: flies a vehicle whose attitude follows late with any gain",
        TRACKING,
        "(ATTITUDE_AT_KP_1_S / vehicle.attitude_time_constant_s) ** 2,",
        "math.inf,",
        "guidance/test_tracking_method.py::test_a_vehicle_whose_attitude_follows_late_comes_to_rest_over_the_pad",
    ),
    Mutant(
        "2: the noise of one picture's axes teaches an error of the lens",
        "landerd/estimation/bias_linearisation.py",
        "return new._replace(about_x=x, about_y=y)",
        "return new",
        "estimation/test_pad_filter.py::test_a_gimbals_noise_about_the_line_of_sight_tells_nothing_of_the_lens",
    ),
    Mutant(
        "3: no limit of the vertical speed",
        LIMITS,
        "clamp(v[2], -limits.climb_mps, limits.descent_mps)",
        "v[2]",
        "guidance/test_limits.py::test_no_demand_breaks_a_limit",
    ),
    Mutant(
        "3: no limit of the vertical acceleration",
        LIMITS,
        "most = limits.vertical_acceleration_mps2",
        "most = 9.0",
        "guidance/test_limits.py::test_no_demand_breaks_a_limit",
    ),
    Mutant(
        "3: an order not to turn fades out",
        LIMITS,
        "self._yaw_rate = slewed if rate != 0.0 else 0.0",
        "self._yaw_rate = slewed",
        "guidance/test_limits.py::test_an_order_not_to_turn_is_immediate",
    ),
    Mutant(
        "3: a late step is a large one",
        LIMITS,
        "MAX_STEP_S = 0.05",
        "MAX_STEP_S = 9.0",
        "guidance/test_limits.py::test_a_late_tick_breaks_no_limit_either",
    ),
    Mutant(
        "4: contact is believed at any height",
        TOUCHDOWN,
        "is_slow = now - self._slow_since >= CONTACT_S and clearance <= highest_m",
        "is_slow = now - self._slow_since >= CONTACT_S",
        "guidance/test_touchdown.py::test_contact_is_not_believed_more_than_a_legs_length_above_the_pad",
    ),
    Mutant(
        "4: stays without thrust while it sinks",
        TOUCHDOWN,
        "self._level = begins or (self._level and stays)",
        "self._level = begins or self._level",
        "guidance/test_touchdown.py::test_thrust_comes_back_as_soon_as_it_sinks_without",
    ),
    Mutant(
        "4: thrust comes back in a rebound from the plate",
        TOUCHDOWN,
        "stays = not sinks or self._rebounds(motion) or",
        "stays = not sinks or",
        "guidance/test_touchdown.py::test_a_rebound_from_the_plate_does_not_bring_the_thrust_back",
    ),
    Mutant(
        "4: levelled while it sinks as it would in the air",
        TOUCHDOWN,
        "return told_up or held_up_mps > PRESSED_DOWN_SHARE * self._descent_mps",
        "return True",
        "guidance/test_touchdown.py"
        "::test_a_slow_vehicle_over_a_deck_that_begins_to_sink_is_not_levelled_in_the_air",
    ),
    Mutant(
        "4: levelled where it sinks later than predicted",
        TOUCHDOWN,
        "clamp(self._measured_mps, in_air - IN_AIR_ERROR_MPS, in_air)",
        "in_air",
        "guidance/test_touchdown.py"
        "::test_a_vehicle_that_rose_late_with_a_deck_is_not_levelled_over_it_as_both_turn",
    ),
    Mutant(
        "4: contact is believed where the pad is seen lower",
        COMMITTED,
        "highest_m = BUILD_ERROR_M if is_seen else MAX_CONTACT_HEIGHT_M",
        "highest_m = MAX_CONTACT_HEIGHT_M",
        "guidance/test_landing.py::test_a_vehicle_that_hovers_over_a_pad_in_sight_has_not_touched",
    ),
    Mutant(
        "4: told to climb, what the pad holds is taken to fly",
        TOUCHDOWN,
        "told_up = ordered <= 0.0",
        "told_up = False",
        "guidance/test_landing.py"
        "::test_a_vehicle_on_the_pad_stays_there_when_the_autopilot_restarts",
    ),
    Mutant(
        "4: levelled just as it may lift after a wave-off",
        LEAVING,
        "self._touchdown.press(now)",
        "pass",
        "guidance/test_landing.py"
        "::test_waved_off_as_it_touches_unnoticed_it_is_pressed_down_where_its_thrust_is_not_back",
    ),
    Mutant(
        "4: levelled as its feet come free after a wave-off",
        LEAVING,
        "THRUST_BACK_S, LIFTED_S = 0.45, 2.5",
        "THRUST_BACK_S, LIFTED_S = 0.45, 0.0",
        "guidance/test_landing.py::test_waved_off_it_is_not_levelled_as_its_feet_come_free",
    ),
    Mutant(
        "1b: climbs on after its second where it rests on a moving pad",
        LEAVING,
        "if not (self._flies_on and stands and event is Event.CLEAR_OF_PAD):",
        "if not (stands and event is Event.CLEAR_OF_PAD):",
        "guidance/test_landing.py"
        "::test_released_it_climbs_away_for_a_second_at_most_also_where_it_rests_on_the_pad",
    ),
    Mutant(
        "1b: stopped just over a moving pad that it still sinks to",
        BELOW,
        "SINKS_ON_S = 0.1",
        "SINKS_ON_S = 0.0",
        "simulation/test_faults.py::test_a_link_that_dies_as_it_sinks_onto_a_moving_pad",
    ),
    Mutant(
        "1b: hovers where it sinks onto a moving pad before it is stopped",
        BELOW,
        "STOPS_OVER_PAD_M = 0.10",
        "STOPS_OVER_PAD_M = -9.0",
        "guidance/test_landing.py::"
        "test_sight_lost_as_it_sinks_fast_to_a_pad_that_moves_it_climbs_with_the_pad",
    ),
    Mutant(
        "4: a foot that leans up is taken to be down",
        "landerd/estimation/vehicle_state.py",
        "return max(dot(rotate(R, foot), normal)",
        "return 0.04 + max(dot(rotate(R, foot), (0.0, 0.0, 1.0))",
        "guidance/test_landing.py::test_leaning_as_the_pad_does_no_foot_is_taken_to_be_down",
    ),
    Mutant(
        "4: flies on beside a pad that slid away under it",
        ON_PAD,
        "return slides and clears and context.sight is not None",
        "return False",
        "guidance/test_landing.py::test_on_a_pad_seen_to_slide_away_under_its_feet_it_is_waved_off",
    ),
    Mutant(
        "6: told to have landed on a pad that it fell off",
        LANDING,
        "return below > FALLEN_M",
        "return False",
        "guidance/test_landing.py::test_a_vehicle_that_ends_below_the_plate_has_not_landed_on_the_pad",
    ),
    Mutant(
        "6: the time of a landing runs while others fly",
        "landerd/guidance/state_silent.py",
        "self._context.attempts.end()",
        "pass",
        "guidance/test_landing.py::test_time_released_does_not_count_in_the_time_of_the_landing",
    ),
    Mutant(
        "7: whoever connects cuts the autopilot's link",
        "hw/links/tcp.py",
        "if self._transport is not None and now - self._heard_t <= SILENT_S:",
        "if False:",
        "hw/links/test_links.py::test_a_second_connection_does_not_cut_that_of_the_autopilot",
    ),
    Mutant(
        "5: a sensor that was reset tells its last angle",
        "hw/gimbals/imu.py",
        "if not any(data[:3]) and waited_s > _STARTS_S:",
        "if False:",
        "hw/gimbals/test_imu.py::test_a_chip_that_was_reset_is_lost_and_set_up_again",
    ),
    Mutant(
        "1b: stopped with thrust where it touches before that is sure",
        LANDING,
        "return Event.RELEASED_TOUCHING if self._takes_touch() else Event.RELEASED",
        "return Event.RELEASED",
        "guidance/test_landing.py"
        "::test_released_as_it_touches_before_that_is_sure_it_is_levelled_once_it_lies_there",
    ),
    Mutant(
        "2: the descent region grows without end",
        PHASES,
        "k = clamp((self._waited_s - WIDENS_AFTER_S) / WIDENS_S, 0.0, 1.0)",
        "k = max(0.0, (self._waited_s - WIDENS_AFTER_S) / WIDENS_S)",
        "guidance/test_phases.py"
        "::test_the_descent_region_grows_to_its_limit_while_gusts_keep_it_from_sinking",
    ),
    Mutant(
        "4: disarms on ON_GROUND sooner than the autopilot can know",
        TOUCHDOWN,
        "CONFIRMED_S = 0.5",
        "CONFIRMED_S = 0.0",
        "guidance/test_touchdown.py::test_on_ground_reported_sooner_than_the_autopilot_can_know_does_not_disarm",
    ),
    Mutant(
        "4: ON_GROUND is contact while it sinks as ordered",
        TOUCHDOWN,
        "says_so = landed is Landed.ON_GROUND and self.may_touch",
        "says_so = landed is Landed.ON_GROUND",
        "guidance/test_touchdown.py::test_on_ground_is_not_believed_while_it_sinks_as_ordered",
    ),
    Mutant(
        "4: levelled while it creeps down on an air cushion",
        TOUCHDOWN,
        "SETTLES_M = 0.01",
        "SETTLES_M = 9.0",
        "guidance/test_touchdown.py::test_a_vehicle_that_sinks_slowly_on_an_air_cushion_is_not_levelled",
    ),
    Mutant(
        "5: flies on a frozen position",
        "landerd/runtime/frozen_input.py",
        "Report = Attitude | LocalPosition | GimbalState",
        "Report = Attitude | GimbalState",
        "runtime/test_frozen_input.py::test_a_report_that_always_changed_and_then_repeats_is_frozen[LocalPosition]",
    ),
    Mutant(
        "6: says landed although only a heartbeat says disarmed",
        LANDING,
        "(self._gate.disarmed and on_ground)",
        "self._gate.disarmed",
        "guidance/test_landing.py::test_disarmed_on_the_pad_without_on_ground_is_not_called_landed",
    ),
    Mutant(
        "4: climbs from the pad on which it stands",
        LEAVING,
        "stands = rests and self._touchdown.stands",
        "stands = False",
        "guidance/test_landing.py::"
        "test_released_as_it_touches_a_moving_pad_it_stands_there_until_its_thrust_is_back",
    ),
    Mutant(
        "5: takes for stale what came while it stood still",
        "landerd/runtime/daemon.py",
        "await _catch_up(self.monitor.woke(due))",
        "self.monitor.woke(due)",
        "simulation/test_fault_defects.py"
        "::test_messages_that_arrived_during_a_stall_are_read_before_the_next_decision",
    ),
    Mutant(
        "5: the clock's uncertainty is no age",
        GATE,
        "self._clock_s = clock.uncertainty_s",
        "self._clock_s = 0.0",
        "guidance/test_gate.py::test_half_the_round_trip_counts_as_age",
    ),
    Mutant(
        "6: says landed with a foot beside the plate",
        LANDING,
        "return Event.DISARMED if on_plate else Event.DISARMED_OFF_PAD",
        "return Event.DISARMED",
        "test_lander.py::test_disarmed_with_a_foot_beside_the_plate_is_not_called_landed",
    ),
    Mutant(
        "6: a landing may take for ever",
        ATTEMPTS,
        "return now - self._began > self._options.total_s",
        "return False",
        "test_lander.py::test_a_landing_that_takes_too_long_is_handed_back",
    ),
    Mutant(
        "6: holding ends when a landing would take too long",
        LANDING,
        "if self._gate.with_pilot or hold_asked:",
        "if self._gate.with_pilot:",
        "guidance/test_hold.py::test_it_holds_for_longer_than_a_landing_may_take",
    ),
    Mutant(
        "6: descents may be broken off for ever",
        ATTEMPTS,
        "return self._descents_broken_off > self._options.retries",
        "return False",
        "test_lander.py::test_a_landing_that_may_never_commit_is_handed_back_to_the_pilot_from_higher_up",
    ),
    Mutant(
        "7: saves parameters while armed",
        "hw/autopilots/mavlink.py",
        "            if disarmed:\n                result",
        "            if True:\n                result",
        "hw/autopilots/test_parameter_protocol.py::test_nothing_is_saved_while_armed",
    ),
    Mutant(
        "7: limits and switch may be changed in flight",
        "landerd/config/parameters.py",
        "if not (disarmed or parameter.in_flight):",
        "if False:",
        "config/test_parameters.py::test_while_armed_gains_change_and_the_gate_and_limits_do_not",
    ),
    Mutant(
        "7: a stranger on UDP is listened to",
        "hw/links/udp.py",
        "if self._listen and not self._accepts(data, addr):",
        "if False:",
        "hw/links/test_udp_peer.py::test_a_stranger_is_neither_heard_nor_answered",
    ),
    Mutant(
        "7: a signed message counts twice",
        "hw/autopilots/signing.py",
        "if stamp <= oldest:",
        "if False:",
        "hw/autopilots/test_signing.py::test_unsigned_forged_and_repeated_messages_are_refused_and_counted",
    ),
    Mutant(
        "6: stops for ever where it may fly and sees no pad",
        SILENT,
        "if step.now - self._began > context.options.lost.give_up_s:",
        "if False:",
        "guidance/test_landing.py"
        "::test_granted_again_while_it_stops_without_the_pad_it_hands_back_after_a_while",
    ),
    Mutant(
        "4: takes for a slide that the pad levels it about an edge",
        COMMITTED,
        "return replace(relative, error_rate=rate) if slides_less else relative",
        "return relative",
        "guidance/test_landing.py::test_touching_with_an_edge_it_leans_over_it_is_not_sliding_off",
    ),
    Mutant(
        "1b: forgets for want of data that it stood",
        TOUCHDOWN,
        "if has_settled or (released and self.stands):",
        "if has_settled:",
        "guidance/test_landing.py::test_a_vehicle_that_stood_is_left_standing_when_released_without_data",
    ),
    Mutant(
        "4: presses on with thrust for want of data",
        TOUCHDOWN,
        "if has_settled or (released and self.stands):",
        "if released and (self.stands or has_settled):",
        "guidance/test_landing.py::test_pressed_down_for_long_without_data_it_stands_level",
    ),
    Mutant(
        "4: notices no contact that wrong velocities hide",
        "landerd/guidance/rest_detector.py",
        "return now - min(self._since, self._unchanged_since) >= RESTS_HIGHER_S",
        "return now - self._since >= RESTS_HIGHER_S",
        "guidance/test_landing.py::test_sight_shows_a_touch_down_that_wrong_velocities_hide",
    ),
    Mutant(
        "4: a velocity that is wrong keeps it from being levelled",
        TOUCHDOWN,
        "motion = replace(motion, sink_rate=self._sink_rate(now, motion))",
        "pass",
        "guidance/test_touchdown.py"
        "::test_a_vehicle_that_stands_is_levelled_whatever_its_autopilot_says_of_its_velocity",
    ),
    Mutant(
        "6: on the ground without contact, the pilot is told nothing",
        TOUCHDOWN,
        "return not self.has_touched or landed is not",
        "return landed is not",
        "guidance/test_touchdown.py"
        "::test_a_commit_that_shows_no_contact_for_long_is_unconfirmed_too",
    ),
    Mutant(
        "4: presses on with thrust for seconds for want of data",
        TOUCHDOWN,
        "LEVEL_UNKNOWN_S = 1.0",
        "LEVEL_UNKNOWN_S = LEVEL_AT_LATEST_S",
        "guidance/test_landing.py::test_pressed_down_for_long_without_data_it_stands_level",
    ),
    Mutant(
        "2: a deck that was seen to heave from higher up counts as standing",
        BELOW,
        "is_near = relative.height < HEAVE_SEEN_M",
        "is_near = self.low",
        "guidance/test_landing.py"
        "::test_to_a_deck_that_heaved_as_it_was_seen_from_3_m_it_sinks_more_slowly",
    ),
    Mutant(
        "4: drives on as the pad did that has stopped, when data are stale",
        BELOW,
        "if not self.carries:",
        "if not self.carries or vehicle is None:",
        "guidance/test_landing.py"
        "::test_on_a_pad_that_has_braked_stale_data_are_no_reason_to_drive_on",
    ),
    Mutant(
        "1b: takes a turn from descent to climb, just over the pad, for rest",
        LEAVING,
        "back_s = min(back_s, THRUST_BACK_S) if may_touch else 0.0",
        "back_s = min(back_s, THRUST_BACK_S)",
        "guidance/test_landing.py"
        "::test_released_just_over_a_pad_its_turn_to_climb_is_not_taken_for_rest",
    ),
    Mutant(
        "1b: levels a released vehicle whose deck has sunk away from under it",
        ON_PAD,
        "if is_left or not _stand_level(context, self._touchdown, step, released=True):",
        "if not _stand_level(context, self._touchdown, step, released=True):",
        "guidance/test_landing.py"
        "::test_released_over_a_deck_that_sinks_away_it_is_not_levelled_in_the_air",
    ),
    Mutant(
        "4: keeps a vehicle with thrust whose pad brakes faster than set-points may",
        CONTACT,
        "BEHIND_MPS = 0.5",
        "BEHIND_MPS = math.inf",
        "guidance/test_landing.py"
        "::test_on_a_pad_that_brakes_faster_than_set_points_may_follow_it_is_levelled",
    ),
    Mutant(
        "4: levels what leans and is behind only if its pad is seen to carry it",
        CONTACT,
        "else sum(signs) > 1",
        "else signs[0] and sum(signs) > 1",
        "guidance/test_landing.py"
        "::test_on_a_pad_that_starts_and_slides_under_it_it_is_levelled_as_it_leans",
    ),
    Mutant(
        "4: drives on as the pad did before it stopped out of sight",
        BELOW,
        "if now - self._departs_since >= DEPARTS_S:",
        "if now - self._departs_since >= math.inf:",
        "guidance/test_landing.py"
        "::test_on_a_pad_that_changes_its_speed_out_of_sight_it_goes_with_it_and_has_landed",
    ),
    Mutant(
        "1b: stops what has just touched for as long as orders are streamed",
        LANDING,
        "return LastOrders(STOPPED, wait_s, level, release_s - wait_s)",
        "return LastOrders(None, 0.0, STOPPED, release_s)",
        "guidance/test_landing.py"
        "::test_should_the_core_fail_just_after_the_touch_the_vehicle_is_to_stand_level",
    ),
    Mutant(
        "1b: a failed core's last orders go on after guidance.release_s",
        LANDING,
        "return LastOrders(STOPPED, wait_s, level, release_s - wait_s)",
        "return LastOrders(STOPPED, wait_s, level, release_s)",
        "guidance/test_landing.py"
        "::test_should_the_core_fail_just_after_the_touch_the_vehicle_is_to_stand_level",
    ),
    Mutant(
        "4: drives on as the pad was taken to at the touch, whatever is seen of it",
        BELOW,
        "if now - self._differs_since >= DIFFERS_S:",
        "if now - self._differs_since >= math.inf:",
        "guidance/test_landing.py"
        "::test_a_pad_that_is_seen_to_speed_up_under_feet_that_slide_is_gone_with",
    ),
    Mutant(
        "4: is not levelled as it tips over where it stands",
        TOUCHDOWN,
        "tips = tips or self._tips_where_it_stands(motion)",
        "tips = tips",
        "guidance/test_touchdown.py"
        "::test_a_vehicle_that_leans_ever_more_where_it_stands_is_levelled",
    ),
    Mutant(
        "6: forgets that a levelled vehicle turned over",
        "landerd/guidance/landing.py",
        "TURNS_OVER_S and not self._touchdown.turned_over",
        "TURNS_OVER_S and not self._touchdown.is_level",
        "guidance/test_landing.py"
        "::test_a_levelled_vehicle_that_turns_over_and_falls_back_onto_its_feet_has_not_landed",
    ),
    Mutant(
        "4: sliding down a tilted plate counts as settling",
        "landerd/guidance/touchdown.py",
        "> SETTLES_M + slid_m * slope",
        "> SETTLES_M",
        "guidance/test_touchdown.py"
        "::test_a_vehicle_that_slides_down_a_tilted_plate_is_levelled_as_soon_as_on_a_level_one",
    ),
    Mutant(
        "4: takes being dragged off a fast pad for an error of its speed",
        "landerd/guidance/touchdown.py",
        "slides = DRAGGED_MPS < motion.slip < MOST",
        "slides = DRAGGED_MPS + motion.slip_error < motion.slip < MOST",
        "guidance/test_touchdown.py::test_what_drags_across_a_fast_pad_is_no_error_of_its_speed",
    ),
    Mutant(
        "4: the last of a slow settling counts as standing",
        TOUCHDOWN,
        "LEVEL_STILL_S + self._settled_s",
        "LEVEL_STILL_S",
        "guidance/test_touchdown.py"
        "::test_a_vehicle_that_settles_slowly_to_the_end_has_stood_still_for_as_long_all_the_same",
    ),
    Mutant(
        "4: gives thrust again on a pad that is lifted",
        TOUCHDOWN,
        "return rises and now - self._level_since < THRUST_GONE_S",
        "return rises",
        "guidance/test_touchdown.py"
        "::test_a_levelled_vehicle_goes_up_by_its_thrust_for_a_moment_and_later_with_its_pad",
    ),
    Mutant(
        "4: given thrust again on a deck that sinks",
        TOUCHDOWN,
        "or self._is_carried(now, motion)",
        "or False",
        "guidance/test_touchdown.py"
        "::test_levelled_for_a_second_it_goes_down_with_its_deck_but_does_not_fall",
    ),
    Mutant(
        "1b: climbs from the pad after a restart of the autopilot",
        LEAVING,
        "if is_unknown and self._touchdown.has_touched:",
        "if False:",
        "guidance/test_landing.py"
        "::test_it_stays_there_too_when_the_autopilot_restarts_just_after_the_touch",
    ),
    Mutant(
        "4: told to climb as its feet arrive",
        COMMITTED,
        "if is_lost and foot_height(relative, vehicle) > -BUILD_ERROR_M:",
        "if False:",
        "guidance/test_landing.py::test_sight_lost_too_long_as_its_feet_arrive_it_goes_on_down",
    ),
    Mutant(
        "1b: released as its feet arrive it is stopped there with thrust",
        COMMITTED,
        "self._touching = self._touching or self._arriving",
        "self._touching = self._touching",
        "guidance/test_landing.py::test_released_as_its_feet_arrive_it_stands_there",
    ),
    Mutant(
        "5: told to descend on stale data until it touches",
        COMMITTED,
        "comes_s = ARRIVES_S if self._touching is None else 0.0",
        "comes_s = 0.0",
        "guidance/test_landing.py"
        "::test_committed_and_its_data_are_stale_before_the_touch_it_is_not_told_to_descend",
    ),
    Mutant(
        "4: told to climb while it stands on one foot",
        COMMITTED,
        "in_air = clearance > (BUILD_ERROR_M if self._touchdown.may_touch else 0.0)",
        "in_air = clearance > 0.0",
        "test_lander.py::test_on_one_foot_it_is_not_told_to_climb_for_the_pad_that_slides_below",
    ),
    Mutant(
        "5: hovers on without a position where a deck may strike it",
        FLYING,
        "may_climb = vehicle is not None or climbs_blind",
        "may_climb = vehicle is not None",
        "test_lander.py"
        "::test_low_over_the_pad_without_a_position_it_climbs_out_of_reach_and_hovers",
    ),
    Mutant(
        "2: sinks on while it is carried out of the region",
        PHASES,
        "LEAVES_S = 0.2",
        "LEAVES_S = 0.0",
        "guidance/test_phases.py"
        "::test_a_vehicle_carried_out_of_the_region_stops_sinking_before_it_is_out",
    ),
    Mutant(
        "5: an attitude between two reports goes by a straight line",
        "landerd/geometry.py",
        "return p + math.sin(pitch) * yaw, math.cos(roll) * q - math.sin(roll) * r, yaw",
        "return 0.0, 0.0, 0.0",
        "estimation/test_camera_pose.py::test_between_two_attitudes_the_vehicle_turns_by_their_rates",
    ),
    Mutant(
        "5: a leaning vehicle's heading turns as fast as its own axis",
        "landerd/estimation/vehicle_state.py",
        "yaw_rate = poses.attitude.newest_rates[2]",
        "yaw_rate = attitude[1][5]",
        "estimation/test_vehicle_state.py::test_a_leaning_vehicle_turns_as_its_heading_does_not_as_its_own_axis",
    ),
    Mutant(
        "2: sinks at once over a ring alone",
        FLYING,
        "RING_ALONE_S = 1.0",
        "RING_ALONE_S = 0.0",
        "guidance/test_landing.py"
        "::test_a_ring_alone_is_looked_at_for_a_second_before_it_sinks_and_again_when_it_was_gone",
    ),
    Mutant(
        "2: sinks as fast above the commit height after commit",
        COMMITTED,
        "sink_rate = min(sink_rate, TOUCHES_AT_MPS)",
        "pass",
        "guidance/test_landing.py"
        "::test_carried_up_again_after_commit_it_sinks_as_slowly_as_the_autopilots_timeout_stops",
    ),
    Mutant(
        "6: an abort that repeats within a second is never told",
        ORDERS,
        "if self._news is not None and self.say(*self._news):",
        "if self._news is not None and (self.say(*self._news) or True):",
        "guidance/test_orders.py"
        "::test_a_loss_that_repeats_within_a_second_is_told_again_when_it_lasts",
    ),
    Mutant(
        "1b: levelled where it slides across the pad when released",
        LEAVING,
        "RESTS_MPS and not slides",
        "RESTS_MPS",
        "guidance/test_landing.py"
        "::test_released_as_it_slides_across_a_pad_that_stopped_it_is_not_levelled",
    ),
    Mutant(
        "4: a landing that begins on the pad takes off",
        FLYING,
        "if context.stands(step.now) and not context.hold_asked:",
        "if False:",
        "guidance/test_landing.py"
        "::test_a_landing_that_begins_on_the_pad_ends_there_and_not_beside_it",
    ),
    Mutant(
        "4: climbs for stale data with a foot down",
        COMMITTED,
        "if self._touching is None:",
        "if True:",
        "guidance/test_landing.py"
        "::test_committed_and_its_data_are_stale_as_it_touches_it_does_not_climb_again",
    ),
    Mutant(
        "4: climbs for stale data as its feet come down",
        COMMITTED,
        "self._touching = self._touching or self._arriving",
        "pass",
        "guidance/test_landing.py"
        "::test_committed_and_its_data_are_stale_as_it_touches_it_does_not_climb_again",
    ),
    Mutant(
        "1b: stops on what another stop has left of its time",
        ON_PAD,
        "self._context.stops_until = -math.inf",
        "pass",
        "guidance/test_landing.py"
        "::test_each_time_that_it_may_not_fly_on_from_the_pad_it_is_stopped_for_as_long",
    ),
    Mutant(
        "2: stopped, it sinks by a wrong climb rate although it sees the pad",
        "landerd/guidance/state_silent.py",
        "if context.may_begin(step.now, stops=True):",
        "if context.may_begin(step.now):",
        "guidance/test_health.py"
        "::test_a_vehicle_that_sinks_by_a_wrong_climb_rate_is_held_at_its_height_by_sight",
    ),
    Mutant(
        "3: swings past the speed limit where the jerk reaches the acceleration in a step",
        "landerd/guidance/limits.py",
        "gain = min(jerk / acceleration, 1.0 / dt)",
        "gain = jerk / acceleration",
        "guidance/test_limits.py"
        "::test_a_gentle_acceleration_reached_at_once_neither_passes_the_speed_nor_swings_about_it",
    ),
    Mutant(
        "6: says that the pad is not found of one in sight",
        "landerd/guidance/state_silent.py",
        "return Event.NO_LANDING_POSSIBLE if is_seen else Event.PAD_NOT_FOUND",
        "return Event.PAD_NOT_FOUND",
        "guidance/test_hold.py"
        "::test_asked_to_hold_as_it_stands_there_it_is_not_told_that_the_pad_is_not_found",
    ),
    Mutant(
        "6: says by a stale position that it has fallen off",
        "landerd/guidance/landing.py",
        "fresh_vehicle(self._now)\n        below",
        "vehicle(self._now)\n        below",
        "guidance/test_landing.py"
        "::test_a_vehicle_on_the_plate_whose_position_goes_stale_has_landed_there",
    ),
    Mutant(
        "6: says of feet on the plate that they are beside it",
        "landerd/guidance/footprint.py",
        "if yaw is not None:",
        "if False:",
        "guidance/test_footprint.py"
        "::test_it_is_the_feet_that_stand_on_the_plate_not_a_circle_through_them",
    ),
    Mutant(
        "4: levels late what is dragged across the plate",
        TOUCHDOWN,
        "return self.leaned and lies and slides",
        "return False",
        "guidance/test_touchdown.py"
        "::test_a_vehicle_that_leaned_and_then_slides_lying_flat_is_levelled",
    ),
    Mutant(
        "4: levels only what rocks no longer as it is dragged",
        TOUCHDOWN,
        "lies = now - self._lies_since >= DRAGGED_FLAT_S",
        "lies = now - self._flat_since >= DRAGGED_FLAT_S",
        "guidance/test_touchdown.py"
        "::test_a_rocking_vehicle_that_is_dragged_off_is_levelled_once_it_lies_on_the_plate",
    ),
    Mutant(
        "4: levels on an edge what is dragged",
        TOUCHDOWN,
        "lies = motion.lean < LIES_FLAT and is_pressed",
        "lies = is_pressed",
        "guidance/test_touchdown.py"
        "::test_a_rocking_vehicle_that_is_dragged_off_is_levelled_once_it_lies_on_the_plate",
    ),
    Mutant(
        "4: levels what slides too fast to stand",
        TOUCHDOWN,
        "slides = DRAGGED_MPS < motion.slip < MOST_DRAGGED_MPS + motion.slip_error",
        "slides = DRAGGED_MPS < motion.slip",
        "guidance/test_touchdown.py"
        "::test_a_vehicle_that_leaned_and_then_slides_lying_flat_is_levelled",
    ),
    Mutant(
        "4: told to climb where the feet come down first",
        FLYING,
        "arrives = self._arrives(step.now, sight)",
        "arrives = False",
        "guidance/test_landing.py::test_a_deck_that_comes_up_before_a_climb_begins_is_landed_on",
    ),
    Mutant(
        "4: put down beside the plate where the feet come down first",
        FLYING,
        "return not context.footprint.will_miss(relative, sight.heading, sinking, tolerance)",
        "return True",
        "guidance/test_landing.py::test_a_deck_that_comes_up_before_a_climb_begins_is_landed_on",
    ),
    Mutant(
        "2: counts on more than the autopilot brakes a descent with",
        FLYING,
        "context.braking_mps2,",
        "o.limits.vertical_acceleration_mps2,",
        "guidance/test_landing.py"
        "::test_it_sinks_no_faster_than_a_gentle_autopilot_can_stop_should_landerd_die",
    ),
    Mutant(
        "4: gives thrust again to what stands level when data are stale",
        ON_PAD,
        "level = touchdown.without_data(step.now, context.landed, released=released)",
        "level = False",
        "guidance/test_landing.py::test_levelled_on_the_pad_it_stays_so_when_data_are_stale",
    ),
    Mutant(
        "2: a plate that is tilted counts seconds later",
        PHASES,
        "self._lean = angle_between(unlagged, relative.normal)",
        "self._lean += dt / LEAN_S * (angle_between(down, relative.normal) - self._lean)",
        "guidance/test_landing.py::test_a_plate_that_is_tilted_just_before_the_touch_is_not_landed_on",
    ),
    Mutant(
        "2: a lean that grows counts seconds later",
        PHASES,
        "unlagged = unit(towards(self._lagging, self._down, 2.0))",
        "unlagged = self._down",
        "guidance/test_landing.py::test_a_lean_that_grows_all_the_way_down_is_known_before_the_touch",
    ),
    Mutant(
        "6: waits for the heading where a narrow lens cannot see it",
        PHASES,
        "HIGHER_AFTER_S, HIGHER_PER_S, MOST_HIGHER = 3.0, 0.25, 3.0",
        "HIGHER_AFTER_S, HIGHER_PER_S, MOST_HIGHER = 3.0, 0.0, 3.0",
        "guidance/test_phases.py"
        "::test_where_no_heading_is_seen_at_the_alignment_height_it_climbs_to_see_more",
    ),
    Mutant(
        "2: waits for a lull where a foot of a leaning vehicle touches",
        PHASES,
        "return max(LULL_HEIGHT_M, alignment_m if turns else 0.0)",
        "return alignment_m if turns else LULL_HEIGHT_M",
        "guidance/test_landing.py::"
        "test_leaning_too_far_it_waits_with_clear_feet_also_where_the_alignment_height_is_low",
    ),
    Mutant(
        "2: waits for a lull where it would be over before the vehicle is down",
        PHASES,
        "return max(LULL_HEIGHT_M, alignment_m if turns else 0.0)",
        "return max(LULL_HEIGHT_M, alignment_m)",
        "guidance/test_landing.py::"
        "test_leaning_too_far_to_touch_it_waits_over_the_pad_for_a_lull_and_then_hands_back",
    ),
    Mutant(
        "6: does not tell that it comes no nearer",
        "landerd/guidance/state_flying.py",
        'return "" if self._gets_nearer(relative) else why',
        'return ""',
        "guidance/test_landing.py::"
        "test_an_approach_that_does_not_come_nearer_is_told_every_ten_seconds",
    ),
    Mutant(
        "2: comes down however far it leans",
        PHASES,
        "self.leans = leans and relative.height",
        "self.leans = False and relative.height",
        "guidance/test_landing.py::"
        "test_leaning_too_far_to_touch_it_waits_over_the_pad_for_a_lull_and_then_hands_back",
    ),
    Mutant(
        "4: a landing begins on a pad that it may stand on",
        CONTEXT,
        "waits = self.hold_asked if rests else self.rest.is_possible",
        "waits = self.hold_asked and rests",
        "guidance/test_landing.py::test_no_landing_begins_while_it_may_already_stand_on_the_pad",
    ),
    Mutant(
        "4: climbs from a pad on which it only seems not to stand",
        "landerd/guidance/rest_detector.py",
        "return now - min(self._since, self._unchanged_since) >= RESTS_HIGHER_S",
        "return now - self._unchanged_since >= RESTS_HIGHER_S",
        "guidance/test_landing.py::"
        "test_a_landing_begun_on_feet_that_seem_to_be_over_the_pad_ends_there",
    ),
    Mutant(
        "method: smooths a pad that sways as if the airframe swung",
        TRACKING,
        "by = min(lags, shown, MAX_SMOOTHED_MPS) - self._lead_s * accelerates",
        "by = min(lags, MAX_SMOOTHED_MPS)",
        "guidance/test_tracking_method.py::"
        "test_a_pad_that_sways_is_followed_closely_enough_to_land_on",
    ),
    Mutant(
        "6: landed is told of what was dragged off the pad as it was levelled",
        ON_PAD,
        "stands = touchdown.has_rested and not context.below.leaves_behind(step.now)",
        "stands = touchdown.stands and not context.below.leaves_behind(step.now)",
        "guidance/test_landing.py::"
        "test_levelled_as_it_is_dragged_off_and_granted_again_it_has_not_landed_on_the_pad",
    ),
    Mutant(
        "6: turns the lens away from a pad that turns off under the vehicle",
        "landerd/lander.py",
        "if self._landing.has_stood:",
        "if False:",
        "guidance/test_landing.py::"
        "test_a_pad_that_turns_off_under_the_vehicle_that_stands_on_it_stays_in_the_picture",
    ),
    Mutant(
        "1b: a core that fails while the vehicle slides on the pad stops it there",
        "landerd/guidance/landing.py",
        "if self.state in {State.ON_PAD, State.STANDING}:",
        "if self.stands:",
        "guidance/test_landing.py::"
        "test_a_core_that_fails_while_it_slides_on_the_pad_leaves_it_pressed_down",
    ),
    Mutant(
        "4: is not levelled where disarming is refused",
        TOUCHDOWN,
        "ends = landed is Landed.ON_GROUND and not self.is_refused(now)",
        "ends = landed is Landed.ON_GROUND",
        "test_lander.py::test_where_disarming_is_refused_it_stands_level_and_the_pilot_is_told",
    ),
    Mutant(
        "6: does not tell what keeps it from descending",
        "landerd/guidance/state_flying.py",
        'return "" if self._gets_lower(relative) else self._kept_off',
        'return ""',
        "guidance/test_landing.py::test_gusts_that_keep_it_from_descending_are_told",
    ),
    Mutant(
        "6: landed is told of what was blown off the pad after it was levelled",
        ON_PAD,
        "stands = touchdown.has_rested and not context.below.leaves_behind(step.now)",
        "stands = touchdown.has_rested",
        "guidance/test_landing.py::"
        "test_levelled_as_it_slid_and_blown_off_then_it_has_not_landed_on_the_pad",
    ),
    Mutant(
        "vision: motion of a moment hides a code for ever",
        "landerd/vision/print_fit.py",
        "if blur > 1.0 and (fit is None or fit.explained < MIN_EXPLAINED):",
        "if False:",
        "vision/test_whycode.py::test_a_code_is_seen_as_soon_as_the_camera_is_still_again",
    ),
    Mutant(
        "vision: takes another number's code, of which dirt hides a bit",
        "landerd/vision/whycode.py",
        "if mean[n] < _MIN_AGREEMENT or agreement[n].min() < _MIN_BIT_FOUND:",
        "if mean[n] < _MIN_AGREEMENT:",
        "vision/test_whycode.py::test_dirt_on_one_bit_hides_no_code_and_makes_none_of_another",
    ),
    Mutant(
        "vision: loses a code that the image cuts, once its teeth are worn",
        "landerd/vision/whycode.py",
        "np.nansum(levels, axis=0) / np.maximum(count, 1)",
        "np.nansum(levels, axis=0)",
        "vision/test_whycode.py::"
        "test_what_is_followed_as_a_code_shows_its_teeth_as_clearly_as_what_is_found",
    ),
    Mutant(
        "vision: follows a band worn blank as the pad's code",
        "landerd/vision/whycode.py",
        "agreement = np.where(bits_of(code)[is_told], mean, -mean) / ",
        "agreement = np.where(bits_of(code)[is_told], mean, -mean) * 3.0 / ",
        "vision/test_whycode.py::"
        "test_what_is_followed_as_a_code_shows_its_teeth_as_clearly_as_what_is_found",
    ),
    Mutant(
        "vision: takes another id's tag beside a ring out of focus",
        "landerd/vision/square_beside.py",
        "_SURE_CORRELATION, _SURE_LEAD = 0.73, 0.07",
        "_SURE_CORRELATION, _SURE_LEAD = 0.4, 0.0",
        "vision/test_square_beside.py::"
        "test_an_unfocused_tag_with_mud_on_its_corner_tells_the_heading",
    ),
    Mutant(
        "estimation: goes on with a covariance that is none",
        "landerd/estimation/motion_filter.py",
        "if was > 0.0:",
        "if False:",
        "estimation/test_pad_filter.py::"
        "test_a_clock_that_gets_known_between_two_pictures_is_as_if_known_from_the_first",
    ),
    Mutant(
        "estimation: flies on an innovation whose covariance is none",
        "landerd/estimation/pad_filter.py",
        "if innovation.nis < 0.0:",
        "if False:",
        "estimation/test_pad_filter.py::test_an_estimate_without_a_valid_covariance_is_dropped",
    ),
    Mutant(
        "aim: a vehicle that leans looks down before its feet",
        "landerd/guidance/aim.py",
        "to_go = ON_COURSE_PITCH + _lean(base, self.command.yaw) - self.command.pitch",
        "to_go = ON_COURSE_PITCH - self.command.pitch",
        "guidance/test_aim.py::test_a_vehicle_that_leans_looks_as_far_down_from_the_horizon",
    ),
    Mutant(
        "gimbal: servos are led faster than they follow",
        "hw/gimbals/servo.py",
        "_ORDERED_SHARE = 0.5",
        "_ORDERED_SHARE = 10.0",
        "hw/gimbals/test_mavlink_gimbals.py::"
        "test_servo_pulses_go_out_when_they_change_and_once_a_second",
    ),
    Mutant(
        "2: takes what is small and round for a pad of one ring, without its plate",
        "landerd/vision/plate_check.py",
        "return None if is_told and is_seen is False else is_seen",
        "return is_seen if ring in self._headings else None",
        "vision/test_plate_check.py::"
        "test_a_small_ring_without_the_plate_is_not_taken_for_a_pad_of_one_ring",
    ),
    Mutant(
        "believes in a ring whose plate the picture's edge cuts as soon as in another",
        "landerd/estimation/pad_filter.py",
        "least_s = CONFIRM_S if self._is_told else CONFIRM_UNTOLD_S",
        "least_s = CONFIRM_S",
        "estimation/test_pad_filter.py"
        "::test_what_may_be_another_pad_is_believed_once_it_is_shown_not_to_be_or_later",
    ),
    Mutant(
        "takes edges of another ratio for edges in motion",
        "landerd/vision/ring_explained.py",
        "least = _ANOTHER_MOVING_NOISE if e.motion_px > 0.0 else _ANOTHER_NOISE",
        "least = _ANOTHER_NOISE",
        "vision/test_ring_explained.py"
        "::test_a_still_oblique_ring_of_another_ratio_in_blown_out_white_is_none_of_ours",
    ),
    Mutant(
        "looks for squares on textured ground in the second picture only",
        "landerd/vision/search.py",
        "return rings, self._large_squares(image)",
        "return rings, []",
        "vision/test_square.py"
        "::test_a_near_tag_without_its_ring_is_seen_in_the_first_picture_of_textured_ground",
    ),
    Mutant(
        "2: takes a wheel for a ring",
        "landerd/vision/ring_explained.py",
        "if is_ring and is_even and",
        "if is_ring and",
        "vision/test_plate_check.py::test_a_wheel_with_a_hub_darker_than_its_surroundings_is_not_the_pad",
    ),
    Mutant(
        "2: takes a faint thin circle in blown-out white for a ring",
        "landerd/vision/ring_explained.py",
        "> _CLIPPED and black < _CLIPPED_BLACK",
        "> _CLIPPED",
        "vision/test_ring_explained.py::"
        "test_a_faint_thin_circle_in_blown_out_white_is_none_of_ours",
    ),
    Mutant(
        "vision: dirt darker than faded ink hides a tag",
        "landerd/vision/square_fit.py",
        "return fit if self._edges.is_own(image, camera, fit) else None",
        "return None",
        "vision/test_square.py::"
        "test_a_faded_tag_is_tracked_under_dirt_that_is_darker_and_another_is_not",
    ),
    Mutant(
        "vision: dirt in its hole hides a ring in a hard shadow",
        "landerd/vision/ring_explained.py",
        "(inner < _EVEN * outer and not is_ring_by_edges(e))",
        "inner < _EVEN * outer",
        "vision/test_ring_match.py::test_a_hard_shadow_with_dirt_on_the_hole_does_not_hide_a_far_ring",
    ),
    Mutant(
        "5: believes a velocity that jumps as none can",
        "landerd/estimation/camera_pose.py",
        "self._doubts = has_jumped and off_mps > KNOCK_MPS",
        "self._doubts = False",
        "estimation/test_camera_pose.py::"
        "test_a_velocity_that_the_positions_contradict_is_not_believed_however_long_it_is_told",
    ),
    Mutant(
        "5: believes a velocity that is suddenly off by a metre a second",
        "landerd/estimation/camera_pose.py",
        "FASTEST_MPS2, KNOCK_MPS, MOVES_S = 12.0, 0.3, 0.1",
        "FASTEST_MPS2, KNOCK_MPS, MOVES_S = 25.0, 0.5, 0.1",
        "estimation/test_camera_pose.py::test_a_velocity_biased_by_a_metre_a_second_is_not_believed",
    ),
    Mutant(
        "2: turns to the north of a plate that carries another pad's code",
        "landerd/vision/plate_heading.py",
        "if not self._is_another(image, camera, t, north):",
        "if True:",
        "vision/test_plate_heading.py::test_a_plate_with_another_code_on_it_gives_no_heading",
    ),
    Mutant(
        "2: on snow a ring beside another pad's code is taken for the pad's",
        "landerd/vision/plate_heading.py",
        "return not self._is_another(image, camera, t, axes @ rotation_2d(float(self.angles[k])))",
        "return True",
        "vision/test_plate_check.py::test_on_ground_as_bright_as_the_plate_a_ring_beside_another_code_is_not_the_pad",
    ),
    Mutant(
        "2: things that move through the picture keep the pad from being looked for",
        "landerd/vision/ring_work.py",
        "return self._has_more() and self._turns[self.part] < _MOST_TURNS",
        "return self._has_more()",
        "vision/test_ring_work.py::"
        "test_new_outlines_in_every_image_do_not_keep_the_other_parts_of_a_search_waiting",
    ),
    Mutant(
        "2: takes a ring for the pad's whose surroundings are white at any heading",
        "landerd/vision/plate_heading.py",
        "return leads and float(seen.max()) > _LEAST_STANDS_OUT",
        "return float(seen.max()) > _LEAST_STANDS_OUT",
        "vision/test_plate_check.py::"
        "test_round_a_ring_in_a_target_the_plate_stands_out_at_no_heading",
    ),
    Mutant(
        "2: takes a ring for the pad's though its heading is only its plate's",
        "landerd/vision/vision.py",
        "return not self._was_read or prior.pad is None or prior.pad.north is None",
        "return prior.pad is None or prior.pad.north is None",
        "vision/test_plate_heading.py::"
        "test_while_the_heading_is_known_by_the_plate_alone_a_ring_without_a_plate_is_refused",
    ),
    Mutant(
        "1b: one boot time that does not fit is a restart",
        "hw/autopilots/restart_detector.py",
        "if is_ahead or (is_back and not is_answer):",
        "if False:",
        "hw/autopilots/test_mavlink.py::test_one_stamp_that_does_not_fit_is_no_restart",
    ),
    Mutant(
        "1b: stopped with thrust in wind as a foot is down",
        "landerd/guidance/landing.py",
        "return stops and self._committed.takes_touch_stopped(self._now)",
        "return False",
        "guidance/test_landing.py"
        "::test_stopped_just_over_the_pad_it_is_levelled_where_wind_has_a_foot_down",
    ),
    Mutant(
        "1b: told to climb for too long to be found on the pad",
        "landerd/guidance/state_leaving.py",
        "elif rests_s >= RESTS_DOWN_S:",
        "elif False:",
        "guidance/test_landing.py"
        "::test_released_just_as_it_touches_a_moving_pad_it_is_found_to_stand_before_it_lifts",
    ),
    Mutant(
        "4: given thrust as it turns over on the ground",
        "landerd/guidance/landing.py",
        "return Event.TURNS_OVER",
        "pass",
        "guidance/test_landing.py::test_a_vehicle_that_turns_over_on_the_ground_is_given_no_thrust",
    ),
    Mutant(
        "5: a climb rate that the height contradicts is flown down on",
        "landerd/guidance/landing_context.py",
        "wrong_climb = self.estimator.poses.climb_rate_is_wrong(step.now)",
        "wrong_climb = False",
        "guidance/test_health.py"
        "::test_a_climb_rate_that_the_height_contradicts_is_not_flown_down_on",
    ),
    Mutant(
        "2: begins to land as fast as the vehicle sinks, however low",
        "landerd/guidance/state_flying.py",
        "down = min(down, max(0.0, self._fastest_sinking(context.sight)))",
        "pass",
        "guidance/test_landing.py::test_taken_over_while_it_sinks_fast_just_over_the_pad_it_orders"
        "_no_more_than_can_be_stopped",
    ),
    Mutant(
        "5: held by the autopilot's climb rate where that is wrong",
        "landerd/guidance/state_flying.py",
        "hold_m = max(self._held_m, o.descent.retry_height_m)",
        "pass",
        "guidance/test_health.py"
        "::test_a_vehicle_that_sinks_by_a_wrong_climb_rate_is_held_at_its_height_by_sight",
    ),
    Mutant(
        "5: told to climb as it stands on the pad with a wrong climb rate",
        "landerd/guidance/rest_detector.py",
        "up = abs(changes if sight.climb_rate_is_wrong else relative.error_rate[2])",
        "up = abs(relative.error_rate[2])",
        "guidance/test_health.py::test_a_vehicle_on_the_pad_with_a_wrong_climb_rate_stays_there",
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
            [*PYTEST, _where(mutant.test)],
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


def _where(test: str) -> str:
    return f"tests/{test}" if "::" in test else f"tests/test_safety.py::{test}"


if __name__ == "__main__":
    sys.exit(main())
