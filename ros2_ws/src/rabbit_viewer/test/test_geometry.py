"""What pictures show: joints where the robot's are, the barriers' area where the barriers are, forces on the cone."""

import casadi as ca
import numpy as np
import pytest
from rabbit_description.state import Array, Leg, StonePreview
from rabbit_sim.kinematics import RabbitFeet
from rabbit_viewer.geometry import ARC, allowed_area, area_triangles, force_arrow, friction_cone
from rabbit_viewer.skeleton import feet, leg_points, torso_points
from rl_cbf_clf_controller.stone_barriers import stone_barriers

RNG = np.random.default_rng(0)
STATES = RNG.uniform(-1, 1, (20, 7))


@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_feet_are_where_the_plant_has_them(bend: float) -> None:
    expected = [RabbitFeet(bend).positions(q) for q in STATES]
    assert feet(STATES, bend) == pytest.approx(np.array(expected))


def test_links_have_their_lengths() -> None:
    for leg in Leg:
        links = np.diff(leg_points(STATES, leg), axis=1)
        assert np.linalg.norm(links, axis=2) == pytest.approx(np.full((20, 2), 0.4))
    assert np.linalg.norm(np.diff(torso_points(STATES), axis=1), axis=2) == pytest.approx(np.full((20, 1), 0.63))


def barriers(point: Array, stone: StonePreview, R1: float, R2: float) -> Array:
    """B1, B2 of a swing foot at `point`."""
    found = stone_barriers(ca.SX(ca.DM(point)), stone.l_min, stone.l_max, stone.height, R1, R2)
    return np.array([float(ca.evalf(each)) for each in found])


def test_area_is_bounded_by_the_barriers() -> None:
    stone, R1, R2 = StonePreview(1, 0.35, 0.40), 1.0, 0.5
    corners = allowed_area(stone.l_min, stone.l_max, R1, R2)
    values = np.array([barriers(corner, stone, R1, R2) for corner in corners])
    assert values.min() > -1e-12
    assert values[:ARC, 1] == pytest.approx(0, abs=1e-12)  # the inner circle
    assert values[ARC:-2, 0] == pytest.approx(0, abs=1e-12)  # the outer circle
    middle = np.array([stone.l_min / 2, 0.0])
    assert barriers(middle, stone, R1, R2)[1] < 0


def enclosed(corners: Array) -> float:
    """A polygon's area by the shoelace formula."""
    x, z = corners.T
    return abs(float(x @ np.roll(z, -1) - z @ np.roll(x, -1))) / 2


@pytest.mark.parametrize(("l_min", "R2"), [(0.35, 0.5), (0.25, 0.3), (0.45, 2.0)])
def test_triangles_fill_the_area(l_min: float, R2: float) -> None:
    corners = allowed_area(l_min, l_min + 0.05, 1.0, R2)
    triangles = area_triangles(corners)
    assert sum(enclosed(triangle) for triangle in triangles) == pytest.approx(enclosed(corners))
    middles = triangles.mean(axis=1)
    inside = [barriers(middle, StonePreview(1, l_min, l_min + 0.05), 1.0, R2).min() for middle in middles]
    assert min(inside) > -1e-3  # between two corners the edge is straight, the circles are not


def test_forces_on_the_cone_lie_on_its_edge() -> None:
    _, right, left = friction_cone(0.8)
    for edge, tangential in ((right, 240.0), (left, -240.0)):
        arrow = force_arrow(np.array([tangential, 300.0]))
        assert np.cross([*arrow, 0], [*edge, 0])[2] == pytest.approx(0)
    assert not force_arrow(np.zeros(2)).any()
