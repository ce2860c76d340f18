"""The implementation of each fault of `hw.sim.fault_options.FAULTS`, by name."""

from collections.abc import Mapping

from hw.sim.faults import (
    air,
    camera,
    computer,
    gimbal,
    link,
    pad,
    pilot,
    scene,
    strangers,
    telemetry,
)
from hw.sim.faults.bench import Effect

EFFECTS: Mapping[str, Effect] = {
    **camera.FAULTS,
    **scene.FAULTS,
    **pad.FAULTS,
    **gimbal.FAULTS,
    **telemetry.FAULTS,
    **link.FAULTS,
    **strangers.FAULTS,
    **pilot.FAULTS,
    **computer.FAULTS,
    **air.FAULTS,
}
