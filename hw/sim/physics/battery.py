"""The battery: power from thrust and climb, fitted to the measured ArduCopter (3 kg)."""

from hw.sim.physics.response import STEP_S

HOVER_W = 354.0
CLIMB_W_PER_MPS = 9.5  # 363 W climbing, 344 W descending 1 m/s
IDLE_W = 20.0  # motors turning without thrust
VOLTAGE_V = 12.6
MEASURED_KG = 3.0


class Battery:
    """Counts the energy drawn.

    By momentum theory the power to hover is proportional to mass^(3/2) over the square root of the
    rotors' area. For geometrically similar vehicles the area is proportional to mass^(2/3), so the
    power is proportional to mass^(7/6).
    """

    def __init__(self, mass_kg: float = MEASURED_KG) -> None:
        """Make a full battery for a vehicle of this mass, kg."""
        self._scale = (mass_kg / MEASURED_KG) ** (7.0 / 6.0)
        self.energy_j = 0.0
        self.power_w = 0.0
        self.voltage_v = VOLTAGE_V

    def step(self, motors: bool, thrust: float, descent_mps: float) -> None:
        """Advance by STEP_S; thrust is in units of the hover thrust."""
        if motors:
            flown = thrust * HOVER_W - CLIMB_W_PER_MPS * descent_mps * min(1.0, thrust)
            self.power_w = self._scale * max(IDLE_W, flown)
        else:
            self.power_w = 0.0
        self.energy_j += self.power_w * STEP_S
