"""Errors of estimates whose truth is known: made by hand, on short walks; shares within chi-square's bounds."""

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from rabbit_estimation.estimation_errors import shares
from rabbit_estimation.policy_errors import compare, errors
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP

STONES = RL_CBF_CLF_QP
WRONG = np.array([[3.0, 0, 4, 0], [6, 0, 0, 8], [5, 12, 0, 0], [0, 0, 0, 0], [0, 8, 15, 0]])  # rows of length
LENGTH = {"V": 5.0, "B1": 10.0, "B2": 13.0, "C1": 0.0, "C2": 17.0}
MU = np.tile(np.eye(4), (2, 1))  # each component by itself, twice
LGV = np.tile([0.0, 3, 0, 0], (8, 1))  # |LgV| + 1 = 4
BETA = [10.0] * 4 + [-10.0] * 4  # mean 0, rms 10


def truth() -> list[Estimates]:
    """Alpha zero, beta 10 at half of the ticks and -10 at the others."""
    return [Estimates(np.zeros((5, 4)), np.full(5, beta)) for beta in BETA]


def test_alpha_off_by_a_known_matrix() -> None:
    found = errors(STONES, [Estimates(WRONG, true.beta) for true in truth()], truth(), MU, LGV)
    for name, length in LENGTH.items():
        unit = 4 if name == "V" else 1
        assert found[name]["error"] == pytest.approx(length / 2 / 10)
        assert found[name]["alpha_rms"] == pytest.approx(length / 2 / unit)
        assert (found[name]["alpha_r2"], found[name]["beta_r2"], found[name]["beta_rms"]) == (None, 1, 0)
    assert found["V_unscaled"]["alpha_rms"] == pytest.approx(5 / 2)


def test_beta_off_by_half_its_deviation_has_three_quarters_explained() -> None:
    found = errors(STONES, [Estimates(true.alpha, true.beta + 5) for true in truth()], truth(), MU, LGV)
    assert all(figures["beta_r2"] == pytest.approx(0.75) for figures in found.values())
    assert all(figures["error"] == pytest.approx(0.5) for figures in found.values())


def assembly(controller: str, policy: str, **plant: object) -> Assembly:
    """Two steps with a robot of twice the mass."""
    parameters = load_parameters("ours", controller=controller)
    terrain = parameters.terrain
    settings = {"mass_scale": 2, "motor_lag": EVALUATION_LAG, "terrain": terrain, "stones": 2, **plant}
    return Assembly(SimulationParameters.model_validate(settings), parameters, policy)


@pytest.mark.parametrize("controller", ["rl-cbf-clf-qp", "rl-clf-qp", "io-rl-clf-qp"])
def test_the_oracle_against_itself_is_exact(controller: str) -> None:
    found = compare(assembly(controller, "oracle"), "policy", [1])
    assert found["walks"][0]["outcome"] == "walked"
    for name, figures in found["quantities"].items():
        constant = name in ("C1", "C2", "y1", "y2", "y3", "y4")  # alpha of a uniformly scaled robot
        assert list(figures.values()) == [0, None if constant else 1, 1, 0, 0], name


@pytest.mark.parametrize(("truth", "within", "above"), [(1.0, 0.95, 0.025), (1.5, 0.0, 1.0), (0.6, 0.0, 0.0)])
def test_the_mean_is_within_its_bounds_as_often_as_they_say(truth, within, above):
    """Errors as large as claimed, too large and too small; walks of different lengths, numbers that come and go."""
    rng = np.random.default_rng(1)
    walks = []
    for length in rng.integers(2000, 3000, 40):
        freedom = rng.choice([8, 12], length)
        walks.append(np.column_stack([truth * rng.chisquare(freedom) / freedom, freedom]))
    walks.append(walks[0][:5])  # a fall
    found = shares(walks)
    assert found[0] == pytest.approx(within, abs=0.02)
    assert found[1] == pytest.approx(above, abs=0.012)
