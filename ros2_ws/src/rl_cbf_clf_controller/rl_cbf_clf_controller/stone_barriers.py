"""The two stepping-stone barriers (Nguyen and Sreenath 2016), relative degree 2.

Swing foot (l, h) from the stance foot, stone [l_min, l_max]:

    B1 = R1 + l_max - |(R1 + l, h)|                         inside the circle about (-R1, 0): before the far edge
    B2 = |(l - l_min/2, h + R2)| - |(l_min/2, R2)|          outside the circle about (l_min/2, -R2): past the near edge

so at touchdown (h = 0, l > 0) both together mean l_min <= l <= l_max [eq:steprange]. Of a stone that is previewed
higher or lower than the stance foot's, h counts from it: both circles move with it.
"""

import casadi as ca

Number = ca.SX | float


def stone_barriers(
    swing: ca.SX, l_min: Number, l_max: Number, height: Number, R1: Number, R2: Number
) -> tuple[ca.SX, ca.SX]:
    """B1 and B2 of the `swing` foot (2,); all in m."""
    length, above = swing[0], swing[1] - height
    outer = distance(R1 + length, above)
    inner = distance(length - l_min / 2, above + R2)
    return R1 + l_max - outer, inner - distance(l_min / 2, R2)


def distance(x: Number, z: Number) -> ca.SX:
    """|(x, z)|."""
    return ca.sqrt(ca.SX(x) ** 2 + ca.SX(z) ** 2)
