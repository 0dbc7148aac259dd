"""Stone barriers against geometry; the rows on the ground's force against the friction cone."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.constraints import ecbf_gains
from rabbit_description.state import StonePreview
from rl_cbf_clf_controller.contact_force import force_rows
from rl_cbf_clf_controller.stone_barriers import stone_barriers
from scipy.linalg import expm

STONE, R1, R2 = StonePreview(1, 0.33, 0.38), 1.0, 0.36


def at(swing, stone=STONE):
    """B1 and B2 of the swing foot."""
    barriers = stone_barriers(ca.SX(ca.DM(swing)), stone.l_min, stone.l_max, stone.height, R1, R2)
    return np.array([float(ca.evalf(barrier)) for barrier in barriers])


@pytest.mark.parametrize(("length", "signs"), [(0.32, (1, -1)), (0.35, (1, 1)), (0.39, (-1, 1))])
def test_on_the_ground_both_hold_exactly_on_the_stone(length, signs):
    assert np.sign(at((length, 0.0))) == pytest.approx(signs)


@pytest.mark.parametrize("height", [0.04, 0.0, -0.04])
def test_of_a_stone_that_is_previewed_higher_the_foots_height_counts_from_it(height):
    uneven = replace(STONE, height=height)
    assert at((0.2, 0.1 + height), uneven) == pytest.approx(at((0.2, 0.1)))
    assert (at((-0.35, 0), uneven) > 0).all()  # a foot may start behind


def test_outer_and_inner_radii():
    for angle in (0.0, 0.1, 0.7, 2.0, np.arctan2(R2, STONE.l_min / 2)):  # on the ground: the stone's edges
        on_outer = (R1 + STONE.l_max) * np.array([np.cos(angle), np.sin(angle)]) - (R1, 0)
        assert at(on_outer)[0] == pytest.approx(0, abs=1e-12)
        radius = np.hypot(R2, STONE.l_min / 2)
        on_inner = radius * np.array([np.cos(angle), np.sin(angle)]) + (STONE.l_min / 2, -R2)
        assert at(on_inner)[1] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("poles", [(70.0, 70.0), (50.0, 100.0)])
def test_where_the_row_holds_and_a_step_begins_inside_the_barrier_stays_positive(poles):
    """B'' = -K_b (B, B') + w with any w >= 0: B >= 0 from B >= 0 and B' + p1 B >= 0 on, and not from everywhere."""
    (k_0, k_1), rng = ecbf_gains(poles), np.random.default_rng(4)
    flow = expm(np.array([[0, 1, 0], [-k_0, -k_1, 1], [0, 0, 0]]) * 1e-4)[:2]  # of B, B', w over 0.1 ms
    for value, excess in rng.uniform((0, 0), (0.1, 8), (20, 2)):
        B = np.array([value, excess - poles[0] * value])
        for _ in range(2000):
            B = flow @ [*B, rng.choice([0.0, rng.exponential(50)])]
            assert B[0] >= -1e-12
    B, lowest = np.array([0.01, -max(poles) * 0.01 - 1]), 0.0
    for _ in range(2000):
        B = flow @ [*B, 0.0]
        lowest = min(lowest, B[0])
    assert lowest < 0


def upper(force, is_literal=False):
    """By how much each row is kept, if the force is (F_N, F_T) whatever mu."""
    given = Affine(ca.SX.zeros(2, 4), ca.SX(ca.DM(force)))
    (block,) = force_rows(given, ca.SX(20.0), ca.SX(0.8), ca.SX(1e5), is_literal)
    return ca.evalf(block.upper).full().ravel()


@pytest.mark.parametrize(("force", "ok"), [((100, 79), True), ((100, -79), True), ((100, 81), False), ((10, 0), False)])
def test_force_rows_are_the_cone(force, ok):
    assert (upper(force) >= 0).all() == ok


@pytest.mark.parametrize("tangential", [50.0, -90.0])
def test_literal_cone_takes_the_present_sign(tangential):
    assert upper((100.0, tangential), is_literal=True)[1] == pytest.approx(80 - abs(tangential))
