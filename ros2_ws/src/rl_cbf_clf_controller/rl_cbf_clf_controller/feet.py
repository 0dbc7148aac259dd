"""Where the swing foot is from the stance foot, as numbers; for what is computed once a step."""

import casadi as ca
from cbf_clf_qp.functions import NumpyFunction, Values
from rabbit_description.state import Array

from rl_cbf_clf_controller.planar_robot import PinnedRobot
from rl_cbf_clf_controller.robot_numbers import RobotNumbers


class Feet:
    """`swing` (2,), m, and its `jacobian` (2, n) at coordinates q (n,) of a robot. One object serves one thread."""

    def __init__(self, numbers: RobotNumbers) -> None:
        robot = PinnedRobot(numbers.structure)
        self._lengths = numbers.joints, numbers.feet
        inputs = {"q": robot.q, "joints": robot.parameters["joints"], "feet": robot.parameters["feet"]}
        found = {"swing": robot.swing, "jacobian": ca.jacobian(robot.swing, robot.q)}
        self._function = NumpyFunction.of("feet", inputs, found)

    def __call__(self, q_s: Array) -> Values:
        """At coordinates in stance/swing order."""
        return self._function(q_s, *self._lengths)
