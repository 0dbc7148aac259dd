"""The best controller, with a share of the torque of a network that joint targets walk: a policy within the step.

torque = (1 - SHARE) of the QP's + SHARE of the network's

The QP's rows hold for its own torque, and for the mixture only as far as the two agree.
"""

from dataclasses import replace

from rabbit_description.state import RobotState
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput

SHARE = 0.25  # found on development plants of all families


class MixedController(Controller):
    """The walking controller beside its `student`, a controller of its own."""

    student: Controller | None = None  # until it is set, the QP's torque alone

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        super().reset(seed)
        if self.student:
            self.student.reset(seed)

    def step(self, state: RobotState) -> ControllerOutput:
        """The torque for one tick; all else is the QP's."""
        output = super().step(state)
        if not self.student:
            return output
        return replace(output, torque=(1 - SHARE) * output.torque + SHARE * self.student.step(state).torque)
