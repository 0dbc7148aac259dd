"""The two stepping-stone barriers (Nguyen and Sreenath 2016), relative degree 2.

Swing foot (l, h) from the stance foot, stone [l_min, l_max]:

    B1 = R1 + l_max - |(R1 + l, h)|                         inside the circle about (-R1, 0): before the far edge
    B2 = |(l - l_min/2, h + R2)| - |(l_min/2, R2)|          outside the circle about (l_min/2, -R2): past the near edge

so at touchdown (h = 0, l > 0) both together mean l_min <= l <= l_max [eq:steprange]. Of a stone that is previewed
higher or lower than the stance foot's, h counts from it: both circles move with it.
"""

import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.ecbf import Barriers, Ecbf
from cbf_clf_qp.rows import Rows
from rabbit_description.state import StonePreview

from rl_cbf_clf_controller.pinned_robot import Kinematics
from rl_cbf_clf_controller.scene import Scene


class StoneBarriers(Ecbf):
    """B1'', B2'' (m/s^2), of the scene's stone. Without `has_rows` they are estimated and not constrained."""

    names = ("B1", "B2")

    def __init__(self, poles: tuple[float, float], rescue_weight: float, has_rows: bool = True) -> None:
        super().__init__(poles, rescue_weight)
        self._has_rows = has_rows

    def barriers(self, scene: Scene) -> Barriers:
        """Of the swing foot.

        Raises:
            ValueError: there is no stone.
        """
        if scene.barriers is None:
            raise ValueError("stone barriers: expected a stone in sight")
        return scene.barriers

    def rows(self, scene: Scene, value: Affine) -> list[Rows]:
        """A row each, if they are wanted."""
        return super().rows(scene, value) if self._has_rows else []


def stone_barriers(feet: Kinematics, stone: StonePreview, R1: float, R2: float) -> Barriers:
    """B1 and B2 of the swing foot for a previewed stone; R1, R2 in m."""
    near = stone.l_min / 2
    length, height = feet.swing.tolist()  # numbers: arrays of two take several times as long
    height -= stone.height
    velocity = feet.swing_rate.tolist()
    r_outer, (outer_x, outer_z), curve_outer = _distance(length + R1, height, *velocity)
    r_inner, (inner_x, inner_z), curve_inner = _distance(length - near, height + R2, *velocity)
    gradient = np.array([[-outer_x, -outer_z], [inner_x, inner_z]])
    return Barriers(
        B=np.array([R1 + stone.l_max - r_outer, r_inner - np.hypot(near, R2)]),
        dB=gradient @ feet.swing_rate,
        jacobian=gradient @ feet.swing_jacobian,
        bias=gradient @ feet.swing_bias + np.array([-curve_outer, curve_inner]),
    )


def _distance(x: float, z: float, rate_x: float, rate_z: float) -> tuple[float, tuple[float, float], float]:
    """|(x, z)|, its gradient, and velocity' Hessian velocity."""
    radius = np.hypot(x, z)
    normal_x, normal_z = x / radius, z / radius
    across = normal_x * rate_z - normal_z * rate_x
    return radius, (normal_x, normal_z), across**2 / radius
