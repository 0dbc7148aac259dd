"""Measurements that are lost on their way."""

from math import isnan

from rabbit_sim.perturbation import Control, Measured, Memory, Number, Perturbation, setting
from rabbit_sim.plant import PlantReading


class SensorDropout(Perturbation):
    """Each tick's is lost or not, whatever became of the last; the last one that came is repeated.

    An episode's first measurement always comes, and of a lab's sensors the first two: the first has no specific force.
    """

    order = 150

    sensor_dropout: Number = setting(
        0.0, 0, 0.9, "probability that a tick's measurement is lost", Control("lost measurements", 0.01)
    )

    def begin(self, memory: Memory) -> None:
        memory.last = None

    def measure(self, memory: Memory, measured: Measured, reading: PlantReading) -> Measured:
        is_lost = memory.last is not None and memory.rng.random() < self.sensor_dropout
        body = memory.last.body if is_lost else None
        if not is_lost or (body and isnan(body.specific_force[0])):
            memory.last = measured
        last: Measured = memory.last.copy()
        return last
