"""The probability of a miss: what is seen of a walk's touchdowns, the fit, and how it is judged."""

import numpy as np
import pytest
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import episode
from rabbit_misses.model import MissProbability
from rabbit_misses.study import judged
from rabbit_misses.touchdowns import FEATURES, Touchdowns
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters
from scipy.special import expit

STEPS = 20_000


def drawn(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Features, misses and the true probabilities of a logistic world with two features that matter."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((STEPS, len(FEATURES)))
    rows[:, 3] = 0.35  # one that never changes
    p = expit(-3.5 + rows[:, 0] - 0.7 * rows[:, 4])
    return rows, (rng.random(STEPS) < p).astype(float), p


def test_the_true_probabilities_are_found() -> None:
    rows, missed, p = drawn(2)
    found = MissProbability.fitted(*drawn(1)[:2], "a logistic world").at(rows)
    assert np.corrcoef(np.log(found), np.log(p))[0, 1] > 0.95
    assert np.mean(np.abs(found - p)) < 0.01
    judgement = judged(found, missed)
    assert judgement.skill > 0.04
    assert sum(group.holds for group in judgement.bins) >= len(judgement.bins) - 1


def test_every_step_is_in_a_bin_and_steps_that_end_alike_leave_no_skill() -> None:
    judgement = judged(np.array([0.0, 0.01, 0.5, 1.0]), np.zeros(4))
    assert sum(group.steps for group in judgement.bins) == 4
    assert np.isnan(judgement.skill)
    assert judged(np.array([0.0, 1.0]), np.array([0.0, 1.0])).skill == 1


def test_the_features_are_those_of_the_landings() -> None:
    """Step lengths, stones and times as the simulator counts them."""
    tuning = load_parameters("best")
    plant = SimulationParameters(terrain="stones", stones=4, motor_lag=0.004, mass_scale=2.0)
    simulation, controller = Assembly(plant, tuning, "zero").build()
    seen, previews = Touchdowns(), dict[int, tuple[float, float]]()

    def note(record: object) -> None:
        stone = record.state.preview  # type: ignore[attr-defined]
        previews[stone.index] = (stone.l_min, stone.l_max - stone.l_min)

    episode(simulation, controller, 3, seen, note)
    landings = simulation.landings
    simulation.close()
    rows = np.array(seen.rows)
    column = {name: rows[:, at] for at, name in enumerate(FEATURES)}
    assert column["step_index"].tolist() == [1, 2, 3]
    assert column["step_length"] == pytest.approx([landing.l for landing in landings[:3]], abs=0.01)
    assert list(zip(column["l_min"], column["stone_width"], strict=True)) == [previews[k] for k in (2, 3, 4)]
    ticks = np.diff([0, *(landing.tick for landing in landings[:3])])
    assert column["speed"] == pytest.approx(column["step_length"] / (0.01 * ticks))
    assert np.all(column["largest_torque"] <= tuning.torque_limit + 1e-9)
    assert np.all(np.isfinite(rows))
