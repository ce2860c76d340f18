"""What the states at the pad share: heights of the feet over it, and whether to stand level."""

import math

from landerd.estimation.camera_pose import DOWN
from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import angle_between, horizontal, sub
from landerd.guidance import pilot_texts
from landerd.guidance.landing_context import ControlStep, LandingContext
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.touchdown import LATE_S, ContactMotion, Touchdown
from landerd.messages import Landed, Severity

# A vehicle on the pad whose velocity differs from the last set-point by this, m/s, is carried by a
# pad that brakes or starts faster than set-points may follow (rule 3), or is blown across it. One
# that was kept at 1 m/s more than its pad's speed leaned back until it tipped over, 0.7 s later.
BEHIND_MPS = 0.5
# How long sight must show that the pad will be missed before it is given up, s: two or three
# pictures.
MISSES_S = 0.09


def least_clearance(
    context: LandingContext, relative: RelativeState, vehicle: VehicleState, pad: PadEstimate
) -> float:
    """Return a lower bound of the lowest foot's height over the pad, m, for the worst tilt.

    Below zero a touch is possible, and the descent is not waved off, say, for a pad that slides.
    """
    return context.footprint.clearance(relative, vehicle.tilt) - _unsure_m(pad)


def foot_height(relative: RelativeState, vehicle: VehicleState) -> float:
    """Return the height of the lowest foot over the pad, m, by the lean of airframe and plate."""
    return relative.height - vehicle.lowest_foot(relative.normal)


def is_arriving(relative: RelativeState, vehicle: VehicleState, sinking: float) -> bool:
    """Tell whether a foot will be down before a climb takes effect.

    Args:
        relative: pad relative to vehicle.
        vehicle: at the same time.
        sinking: sink rate of the foot relative to the pad, m/s.
    """
    return foot_height(relative, vehicle) <= LATE_S * sinking


def lowest_foot(relative: RelativeState, vehicle: VehicleState, pad: PadEstimate) -> float:
    """Return `foot_height` minus its uncertainty (2 sigma), m: contact is believed by it."""
    return foot_height(relative, vehicle) - _unsure_m(pad)


def sure_slip_mps(relative: RelativeState) -> float:
    """Return the speed at which the pad slides under the vehicle minus 2 sigma of it, m/s."""
    return horizontal(relative.error_rate) - 2.0 * relative.sigma_velocity


def level_due(
    context: LandingContext,
    touchdown: Touchdown,
    step: ControlStep,
    vehicle: VehicleState,
    *,
    released: bool = False,
) -> bool:
    """Pass the vehicle's motion on the pad to the touch-down; tell whether to level it.

    Args:
        context: of the landing.
        touchdown: that decides.
        step: of the control task.
        vehicle: now.
        released: landerd may not fly on.
    """
    north, east, _ = context.below.velocity
    v_north, v_east, _ = vehicle.velocity
    slip = math.hypot(v_north - north, v_east - east)
    if context.sight is not None and not context.below.carries:
        # The pad may brake under feet that are up again: its velocity at the touch is not enough.
        slip = max(slip, sure_slip_mps(context.sight.relative))
    heave, sigma_heave = context.below.heave(step.now)
    pad = context.estimator.pad(step.now)
    motion = ContactMotion(
        feet_down=vehicle.feet[2],
        foot_down=vehicle.feet[2] + vehicle.lowest_foot(DOWN),
        pad_down=context.below.down(step.now),
        sink_rate=vehicle.foot_velocity[2],
        slip=slip,
        lean=math.inf if pad is None else angle_between(vehicle.down, pad.normal),
        tilt=vehicle.tilt,
        roll_pitch_rate=vehicle.roll_pitch_rate,
        pad_speed=math.hypot(north, east),
        heave=heave,
        sigma_heave=sigma_heave,
        fastest_heave=context.below.fastest_heave,
    )
    behind_mps = horizontal(sub(context.orders.velocity, vehicle.velocity))
    # Each alone has another cause, too; with any two of them thrust will tip it over.
    signs = (
        context.below.carries,
        touchdown.leans_more(vehicle.tilt),
        behind_mps > BEHIND_MPS,
    )
    tips = touchdown.leaned if released else sum(signs) > 1
    ordered = context.orders.velocity[2]
    return touchdown.level_due(
        step.now, motion, ordered, context.landed, tips=tips, released=released
    )


def tell_unconfirmed(context: LandingContext) -> None:
    """Tell the pilot that he has to disarm, every REMIND_UNCONFIRMED_S."""
    says_landed = context.landed is Landed.ON_GROUND
    text = pilot_texts.NOT_DISARMED if says_landed else pilot_texts.UNCONFIRMED
    every_s = pilot_texts.REMIND_UNCONFIRMED_S
    context.orders.say(Severity.CRITICAL, text, every_s=every_s)


def _unsure_m(pad: PadEstimate) -> float:
    """Return 2 sigma of the pad's height, m."""
    return 2.0 * math.sqrt(pad.covariance[2][2])
