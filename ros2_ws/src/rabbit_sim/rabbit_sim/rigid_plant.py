"""RABBIT as the paper models it: `planar_plant` with its motors, masses and bent links.

There is ground everywhere: a stone missed is told by where the foot landed.
"""

from collections.abc import Sequence

from rabbit_description.state import Array, Leg

from rabbit_sim.actuation import Actuation
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.pinned_dynamics import PinnedDynamics
from rabbit_sim.planar_plant import PlanarPlant
from rabbit_sim.plant import Span
from rabbit_sim.robot_urdf import leg_shape, perturbed_urdf


class RigidPlant(PlanarPlant):
    """See `Plant`."""

    def __init__(self, parameters: SimulationParameters) -> None:
        self._actuation = Actuation(parameters)
        feet = RabbitFeet(leg_shape(parameters))
        urdf = perturbed_urdf(parameters)
        beside = [each.joint_torque(urdf) for each in parameters.in_force() if each.has("joint_torque")]
        dynamics = PinnedDynamics(urdf, feet, beside, parameters.slope)
        super().__init__(dynamics, keeps_path=parameters.needs_path)

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """`q`, `dq` (7,) must have the stance foot at rest; the motors are at rest."""
        self._actuation.rest()
        super().reset(q, dq, stance)

    def set_stones(self, spans: Sequence[Span]) -> None:
        """Nothing to do: there is ground everywhere."""

    def advance(self, command: Array) -> None:
        """One tick under the torques that the motors make of the command (4,), N m."""
        self._hold(self._actuation.advance(command))
