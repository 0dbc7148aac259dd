"""What pictures show: joints where the robot's are, the barriers' area where the barriers are, forces on the cone."""

import casadi as ca
import numpy as np
import pytest
from rabbit_description.state import Array, StonePreview
from rabbit_sim.kinematics import LegShape, RabbitFeet
from rabbit_viewer.geometry import ARC, allowed_area, feet
from rl_cbf_clf_controller.stone_barriers import stone_barriers

RNG = np.random.default_rng(0)
STATES = RNG.uniform(-1, 1, (20, 7))


@pytest.mark.parametrize("links", [(0.0, 1.0), (0.05, 1.0), (-0.02, 1.1)])
def test_feet_are_where_the_plant_has_them(links: tuple[float, float]) -> None:
    expected = [RabbitFeet(LegShape.of(*links)).positions(q) for q in STATES]
    assert feet(STATES, links) == pytest.approx(np.array(expected))


def barriers(point: Array, stone: StonePreview, R1: float, R2: float) -> Array:
    """B1, B2 of a swing foot at `point`."""
    found = stone_barriers(ca.SX(ca.DM(point)), stone.l_min, stone.l_max, stone.height, R1, R2)
    return np.array([float(ca.evalf(value)) for value in found])


def test_area_is_bounded_by_the_barriers() -> None:
    stone, R1, R2 = StonePreview(1, 0.35, 0.40), 1.0, 0.5
    corners = allowed_area(stone.l_min, stone.l_max, R1, R2)
    values = np.array([barriers(corner, stone, R1, R2) for corner in corners])
    assert values.min() > -1e-12
    assert values[:ARC, 1] == pytest.approx(0, abs=1e-12)  # the inner circle
    assert values[ARC:-2, 0] == pytest.approx(0, abs=1e-12)  # the outer circle
    middle = np.array([stone.l_min / 2, 0.0])
    assert barriers(middle, stone, R1, R2)[1] < 0
