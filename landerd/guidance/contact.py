"""What the states at the pad share: how high its feet are over it, and whether to stand level."""

import math

from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import angle_between, horizontal
from landerd.guidance import pilot_texts
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.touchdown import LATE_S, ContactMotion, Touchdown
from landerd.messages import Severity

# The pad is given up when it is seen for so long that it will be missed, s: two or three pictures.
MISSES_S = 0.09


def least_clearance(
    context: LandingContext, relative: RelativeState, vehicle: VehicleState, pad: PadEstimate
) -> float:
    """Return the least that the lowest foot may be over the pad, m: leaning, as low as may be.

    By it a touch is allowed for; not waved off, say, for a pad that seems to slide.
    """
    return context.footprint.clearance(relative, vehicle.tilt) - _unsure_m(pad)


def foot_height(relative: RelativeState, vehicle: VehicleState) -> float:
    """Return the height of the lowest foot over the pad, m, as airframe and plate do lean."""
    return relative.height - vehicle.lowest_foot(relative.normal)


def is_arriving(relative: RelativeState, vehicle: VehicleState, sinking: float) -> bool:
    """Tell whether a foot will be down before a climb answers, at a sink rate of so many m/s."""
    return foot_height(relative, vehicle) <= LATE_S * sinking


def lowest_foot(relative: RelativeState, vehicle: VehicleState, pad: PadEstimate) -> float:
    """Return the least that `foot_height` may be, m: by it contact is believed.

    Its uncertainty counts as in `least_clearance`.
    """
    return foot_height(relative, vehicle) - _unsure_m(pad)


def sure_slip_mps(relative: RelativeState) -> float:
    """Return how fast the pad surely slides away under it, as seen, m/s."""
    return horizontal(relative.error_rate) - 2.0 * relative.sigma_velocity


def level_due(
    context: LandingContext,
    touchdown: Touchdown,
    step: ControlStep,
    vehicle: VehicleState,
    *,
    released: bool = False,
) -> bool:
    """Show the touch-down how the vehicle moves on the pad; tell whether it is to be levelled."""
    north, east, _ = context.below.velocity
    v_north, v_east, _ = vehicle.velocity
    slip = math.hypot(v_north - north, v_east - east)
    if context.sight is not None and not context.below.carries:
        # What the pad did at the touch it may do no longer: it brakes under feet that are up.
        slip = max(slip, sure_slip_mps(context.sight.relative))
    heave, sigma_heave = context.below.heave(step.now)
    pad = context.estimator.pad(step.now)
    motion = ContactMotion(
        feet_down=vehicle.feet[2],
        pad_down=context.below.down(step.now),
        sink_rate=vehicle.foot_velocity[2],
        slip=slip,
        lean=math.inf if pad is None else angle_between(vehicle.down, pad.normal),
        roll_pitch_rate=vehicle.roll_pitch_rate,
        pad_speed=math.hypot(north, east),
        heave=heave,
        sigma_heave=sigma_heave,
    )
    carried = context.below.carries and touchdown.leans_more(vehicle.tilt)
    tips = touchdown.leaned if released else carried
    ordered = context.orders.velocity[2]
    return touchdown.level_due(
        step.now, motion, ordered, context.landed, tips=tips, released=released
    )


def tell_unconfirmed(context: LandingContext) -> None:
    """Tell the pilot, now and again, that the land detector stays silent."""
    text, every_s = pilot_texts.UNCONFIRMED, pilot_texts.REMIND_UNCONFIRMED_S
    context.orders.say(Severity.CRITICAL, text, every_s=every_s)


def _unsure_m(pad: PadEstimate) -> float:
    """Return by how much the pad may be higher than it is said to be, m."""
    return 2.0 * math.sqrt(pad.covariance[2][2])
