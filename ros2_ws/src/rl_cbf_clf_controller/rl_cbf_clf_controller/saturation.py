"""Torque saturation as hard rows, linear in mu: |u(mu)| <= torque_limit."""

import numpy as np
from rabbit_description.state import Array

from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.rows import Rows

NAMES = ("u1", "u2", "u3", "u4")


def saturation_rows(precontrol: Affine, torque_limit: float) -> Rows:
    """Rows for u(mu) = `precontrol`, N m. mu that gives u = 0 is always feasible."""
    return Rows.between(NAMES, precontrol.a, -torque_limit - precontrol.b, torque_limit - precontrol.b)


def clip(torque: Array, torque_limit: float) -> Array:
    """The torque a motor driver lets through, N m."""
    return np.clip(torque, -torque_limit, torque_limit)
