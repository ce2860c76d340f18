"""Checks the gimbal: does it report its angles, and turn as ordered?"""

import asyncio
import math
import statistics
from collections.abc import Callable

from landerd.config.models import Config
from landerd.messages import GimbalCommand, GimbalState
from landerd.ports import DeviceLost, Feedback, Gimbal
from landerd.preflight.finding import Finding, gather

GIMBAL_S = 1.0  # for how long its reports are received
GIMBAL_MOVE_S = 3.0  # how long each motion may take
_MOVE_DEG, _MOVED_DEG = 20.0, 5.0  # turn that is ordered, and least turn that counts as an answer


async def check_gimbal(
    gimbal: Gimbal, config: Config, may_move: Callable[[], bool]
) -> list[Finding]:
    """Return the findings on a gimbal.

    Args:
        gimbal: the driver, not open; it is opened and closed again.
        config: gives limits and freshness.
        may_move: tells whether the gimbal may be moved; called once, after it has answered.
    """
    try:
        await gimbal.open()
        got = await gather(gimbal.state, GIMBAL_S)
        if not got:
            raise DeviceLost("the gimbal says nothing of its angles")
        findings = _gimbal_stream(got, config)
        if config.gimbal.driver == "fixed":
            return findings
        if not may_move():
            text = "not moved: the vehicle is armed, or it is not known to be disarmed"
            return [*findings, Finding("warn", "gimbal motion", text, "disarm and check again")]
        start = got[-1][1]
        if not start.pitch_measured or gimbal.traits.feedback is not Feedback.MEASURED:
            text = "has no feedback: whether it turns the right way cannot be measured"
            return [*findings, Finding("warn", "gimbal motion", text, "look: -90 is straight down")]
        return [*findings, *await _moves(gimbal, start, config)]
    except DeviceLost as e:
        return [
            Finding(
                "fail",
                "gimbal",
                f"{e}: where the camera looks would not be known",
                "check its power, wiring and gimbal.driver",
            )
        ]
    finally:
        await gimbal.close()


def _gimbal_stream(got: list[tuple[float, GimbalState]], config: Config) -> list[Finding]:
    rate = len(got) / GIMBAL_S
    age = statistics.median(t - state.t for t, state in got)
    limit = config.freshness.gimbal_s
    if rate * limit < 2.0 or age > limit:
        return [
            Finding(
                "fail",
                "gimbal rate",
                f"angles come {rate:.0f} times a second, {age:.2f} s old: older than {limit:g} s "
                "they are not flown on",
                "raise its rate, or the link's",
            )
        ]
    return [Finding("ok", "gimbal", f"angles come {rate:.0f} times a second")]


async def _moves(gimbal: Gimbal, start: GimbalState, config: Config) -> list[Finding]:
    """Order a change of pitch, then of yaw, and compare the reported motion with it."""
    limits = {"pitch": config.gimbal.pitch_limits_deg, "yaw": config.gimbal.yaw_limits_deg}
    findings = []
    for axis, (low, high) in limits.items():
        now = math.degrees(getattr(start, axis))
        middle = 0.5 * (low + high)
        step = min(_MOVE_DEG, 0.4 * (high - low)) * (1.0 if now < middle else -1.0)
        if abs(step) <= _MOVED_DEG:
            continue
        came = await _moved_deg(gimbal, start, axis, now + step) - now
        findings += _motion(axis, step, came)
        await asyncio.sleep(0.5)
    return findings or [Finding("ok", "gimbal motion", "pitch and yaw follow orders")]


async def _moved_deg(gimbal: Gimbal, start: GimbalState, axis: str, to_deg: float) -> float:
    """Order an axis to an angle for a while, and return the angle it reports then, degrees."""
    target = {"yaw": start.yaw, "pitch": start.pitch, axis: math.radians(to_deg)}
    gimbal.command(GimbalCommand(**target))
    states = await gather(gimbal.state, GIMBAL_MOVE_S)
    gimbal.command(GimbalCommand(start.yaw, start.pitch))
    return math.degrees(getattr(states[-1][1] if states else start, axis))


def _motion(axis: str, step: float, came: float) -> list[Finding]:
    """Return findings on a reported change of angle (came), given the ordered one; degrees."""
    moved = math.remainder(came, 360.0) * math.copysign(1.0, step)
    if moved < -_MOVED_DEG:
        return [
            Finding(
                "fail",
                "gimbal motion",
                f"{axis} moves the wrong way: {step:+.0f} degrees ordered, {came:+.0f} "
                "came. The camera would turn away from the pad",
                f"reverse its {axis} ({axis}_sign, or the servo's table): landerd "
                "calibrate gimbal finds how",
            )
        ]
    if moved < _MOVED_DEG:
        return [
            Finding(
                "fail",
                "gimbal motion",
                f"{axis} does not follow: {step:+.0f} degrees ordered, {came:+.0f} came "
                f"in {GIMBAL_MOVE_S:g} s",
                "are its motors on, does its mode take orders, are the limits right?",
            )
        ]
    return []
