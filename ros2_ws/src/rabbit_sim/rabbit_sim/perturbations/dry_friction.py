"""Joints with Coulomb friction and stiction, as each engine has it."""

from collections.abc import Sequence
from typing import Any

from rabbit_sim.perturbation import Control, EngineNumber, Perturbation, setting
from rabbit_sim.plant import SUBSTEP_SECONDS


class DryFriction(Perturbation):
    """At rest a joint takes up to so much; sliding it has so much against the motion."""

    coulomb: EngineNumber = setting(
        0.0, 0, 100, "dry friction of each joint, with stiction, N m", Control("dry friction", 0.5, "N m")
    )

    def in_mujoco(self, model: Any) -> None:
        model.dof_frictionloss[3:7] = self.coulomb
        model.dof_solref[3:7] = 2 * SUBSTEP_SECONDS, 1.0  # the least that it allows: a joint at rest creeps by it

    def in_pybullet(self, client: Any, robot: int, motors: Sequence[int]) -> None:
        """A motor that holds still, as strong as the friction."""
        from rabbit_sim.quiet_pybullet import pybullet  # here alone: parameters are read without it

        strength = [self.coulomb] * len(motors)
        client.setJointMotorControlArray(robot, motors, pybullet.VELOCITY_CONTROL, forces=strength)
