"""Stone barriers against geometry and differences; ECBF gains against their closed loop."""

from dataclasses import replace

import numpy as np
import pytest
from cbf_clf_qp.ecbf import ecbf_bound, ecbf_gains
from rabbit_description.state import StonePreview
from rl_cbf_clf_controller.nominal_model import NominalModel
from rl_cbf_clf_controller.pinned_robot import Kinematics
from rl_cbf_clf_controller.stone_barriers import stone_barriers
from scipy.linalg import expm

STONE, R1, R2 = StonePreview(1, 0.33, 0.38), 1.0, 0.36
H = 1e-6


def at(swing, rate=(0.0, 0.0), stone=STONE):
    swing, rate = np.array(swing, float), np.array(rate, float)
    return stone_barriers(Kinematics(swing, rate, np.eye(2, 7), np.zeros(2), swing, rate), stone, R1, R2)


@pytest.mark.parametrize(("length", "signs"), [(0.32, (1, -1)), (0.35, (1, 1)), (0.39, (-1, 1))])
def test_on_the_ground_both_hold_exactly_on_the_stone(length, signs):
    assert np.sign(at((length, 0.0)).B) == pytest.approx(signs)


def test_zero_on_the_edges_and_the_foot_may_start_behind():
    assert at((STONE.l_max, 0)).B[0] == pytest.approx(0, abs=1e-12)
    assert at((STONE.l_min, 0)).B[1] == pytest.approx(0, abs=1e-12)
    assert at((0, 0)).B[1] == pytest.approx(0, abs=1e-12)
    assert (at((-0.35, 0)).B > 0).all()


@pytest.mark.parametrize("height", [0.04, -0.04])
def test_of_a_stone_that_is_previewed_higher_the_foots_height_counts_from_it(height):
    uneven, rate = replace(STONE, height=height), (0.4, -0.3)
    there, level = at((0.2, 0.1 + height), rate, uneven), at((0.2, 0.1), rate)
    assert pytest.approx(level.B) == there.B
    assert there.dB == pytest.approx(level.dB)
    assert (at((-0.35, 0), stone=uneven).B > 0).all()


def test_outer_and_inner_radii():
    for angle in (0.1, 0.7, 2.0):
        on_outer = (R1 + STONE.l_max) * np.array([np.cos(angle), np.sin(angle)]) - (R1, 0)
        assert at(on_outer).B[0] == pytest.approx(0, abs=1e-12)
        radius = np.hypot(R2, STONE.l_min / 2)
        on_inner = radius * np.array([np.cos(angle), np.sin(angle)]) + (STONE.l_min / 2, -R2)
        assert at(on_inner).B[1] == pytest.approx(0, abs=1e-12)


def test_derivatives_by_differences_on_the_robot(state):
    q, dq = state
    model, ddq = NominalModel(), np.array([0.5, -1, 2, 3, -2, 1, 4.0])
    here, ahead, behind = (stone_barriers(model.update(q + t * dq, dq + t * ddq), STONE, R1, R2) for t in (0.0, H, -H))
    assert here.dB == pytest.approx((ahead.B - behind.B) / (2 * H), abs=1e-6)
    assert here.jacobian @ ddq + here.bias == pytest.approx((ahead.dB - behind.dB) / (2 * H), abs=1e-4)


def test_gains_place_the_poles():
    K_b = ecbf_gains((50.0, 100.0))
    assert K_b == pytest.approx([5000, 150])
    assert np.sort(np.linalg.eigvals([[0, 1], [-K_b[0], -K_b[1]]])) == pytest.approx([-100, -50])


def test_on_the_bound_the_barrier_decays_at_its_poles():
    barriers = at((0.2, 0.1), (0.4, -0.3))
    K_b = ecbf_gains((70.0, 70.0))
    assert ecbf_bound(barriers, K_b) == pytest.approx(-4900 * barriers.B - 140 * barriers.dB)


@pytest.mark.parametrize("poles", [(70.0,), (70.0, -1.0), (1.0, 2.0, 3.0)])
def test_poles_are_checked(poles):
    with pytest.raises(ValueError, match="two positive rates"):
        ecbf_gains(poles)


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
