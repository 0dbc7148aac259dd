"""The choice of the plant."""

from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import Plant
from rabbit_sim.pybullet_plant import PybulletPlant
from rabbit_sim.rigid_plant import RigidPlant


def make_plant(parameters: SimulationParameters) -> Plant:
    """The plant that `parameters.plant` names."""
    return RigidPlant(parameters) if parameters.plant == "rigid" else PybulletPlant(parameters)
