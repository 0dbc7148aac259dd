"""Measurements that are lost on their way."""

from rabbit_sim.perturbation import Control, Measured, Memory, Number, Perturbation, setting
from rabbit_sim.plant import PlantReading


class SensorDropout(Perturbation):
    """Each tick's is lost or not, whatever became of the last; the last one that came is repeated.

    An episode's first measurement always comes.
    """

    order = 150

    sensor_dropout: Number = setting(
        0.0, 0, 0.9, "probability that a tick's measurement is lost", Control("lost measurements", 0.01)
    )

    def begin(self, memory: Memory) -> None:
        memory.last = None

    def measure(self, memory: Memory, measured: Measured, reading: PlantReading) -> Measured:
        if memory.last is None or memory.rng.random() >= self.sensor_dropout:
            memory.last = measured
        last: Measured = memory.last.copy()
        return last
