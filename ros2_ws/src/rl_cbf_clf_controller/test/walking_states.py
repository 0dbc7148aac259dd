"""A controller under our parameters, and states that it may be given."""

from typing import Any
from xml.etree import ElementTree

import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_description.planar_urdf import scale_inertials
from rabbit_description.state import Array, RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import Policy, ZeroPolicy


def make_controller(policy: Policy | None = None, **changes: Any) -> Controller:
    """`changes`: of our parameters."""
    parameters = load_parameters("ours", **changes)
    return Controller(parameters, load_gaits(parameters.gait), policy or ZeroPolicy(parameters.problem))


def state_of(q: Array, dq: Array, tick: int = 0, **changes: Any) -> RobotState:
    """The left foot on the ground, before stone 1; no force is measured."""
    values = {"touchdowns": 0, "preview": StonePreview(1, 0.35, 0.40), "contact": np.array([True, False])}
    return RobotState(tick=tick, q=q, dq=dq, **{"foot_force": np.zeros((2, 2)), **values, **changes})


def scaled(urdf: str, factor: float) -> str:
    """The robot with every mass and inertia times `factor`."""
    robot = ElementTree.fromstring(urdf)
    scale_inertials(robot, factor)
    return ElementTree.tostring(robot, encoding="unicode")
