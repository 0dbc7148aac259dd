"""Joint rates that come through a low-pass filter, as a differentiated encoder's do."""

from math import exp

from rabbit_description.state import TICK_SECONDS

from rabbit_sim.perturbation import Control, Measured, Memory, Number, Perturbation, setting
from rabbit_sim.plant import PlantReading


class FilteredRates(Perturbation):
    """Of first order and time constant T: r <- r + (1 - exp(-h / T)) (rate - r), each tick h."""

    order = 138

    rate_lag: Number = setting(
        0.0, 0, 0.1, "time constant of the filter on the joints' rates, s", Control("rates' filter", 0.001, "s")
    )

    def begin(self, memory: Memory) -> None:
        memory.rates = None

    def measure(self, memory: Memory, measured: Measured, reading: PlantReading) -> Measured:
        _, rates = measured.joints
        if memory.rates is not None:
            rates[:] = memory.rates + (1 - exp(-TICK_SECONDS / self.rate_lag)) * (rates - memory.rates)
        memory.rates = rates.copy()
        return measured
