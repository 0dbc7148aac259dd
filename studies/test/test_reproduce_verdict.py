"""Verdicts; the linear programme against answers known beforehand; `--retrain`: trained once by content."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rabbit_experiments.metrics import RunRow
from rabbit_experiments.summary import Walks
from rabbit_experiments.training_setup import training
from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE
from rabbit_reproduce.feasibility import infeasible, measure
from rabbit_reproduce.training import SHIPPED, TrainingJob, read_log, recipes, retrain, training_job
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_cbf_clf_controller.weights import policy_path, read
from rl_trainer.checkpoint import CHECKPOINT, CheckpointError
from rl_trainer.parameters import TrainingParameters

COUNTS = {name: 0 for name, field in RunRow.model_fields.items() if field.annotation in (int, float)}


def walks(*stones: int, of: int = 20) -> Walks:
    """Runs that came so far."""
    rows = [
        RunRow.model_validate(
            COUNTS | {"outcome": "", "stones": n, "success": n == of, "success_with_forces": n == of, "ticks": 1}
        )
        for n in stones
    ]
    return Walks(rows)


@pytest.mark.parametrize(("walked", "passes"), [(10, True), (9, True), (8, False), (0, False)])
def test_nine_of_ten_walk(walked: int, passes: bool) -> None:
    runs = walks(*[20] * walked, *[3] * (10 - walked))
    assert runs.passes is passes
    assert (runs.walked, runs.runs) == (walked, 10)
    low, high = runs.interval
    assert 0 <= low <= walked / 10 <= high <= 1
    assert runs.mean_stones == pytest.approx((20 * walked + 3 * (10 - walked)) / 10)


def test_deviation_and_interval_of_two() -> None:
    """Of 2 and 4: deviation sqrt(2), standard error 1, Student's t of one degree of freedom 12.706."""
    runs = walks(2, 4)
    assert runs.std_stones == pytest.approx(2**0.5)
    assert runs.stones_interval == pytest.approx((0, 3 + 12.7062), abs=1e-3)  # and not 3 - 12.7062
    assert Walks(runs.rows, course=20).stones_interval == pytest.approx((0, 3 + 12.7062), abs=1e-3)
    assert Walks(runs.rows, course=4).stones_interval == (0, 4)
    assert (walks(2).std_stones, walks(2).stones_interval) == (None, None)


Rows = tuple[Array, Array, Array]  # A, lower, upper


def rows(seed: int, slack: Callable[[np.random.Generator], float]) -> Rows:
    """Twelve random rows, each `slack` beyond a random point."""
    rng = np.random.default_rng(seed)
    point, A = rng.uniform(-50, 50, 4), rng.standard_normal((12, 4)) * 10 ** rng.uniform(-3, 3, (12, 1))
    upper = A @ point + np.linalg.norm(A, axis=1) * slack(rng)
    return A, np.full(12, -np.inf), upper


@given(st.integers(0, 2**32 - 1))
def test_rows_that_a_point_meets_are_feasible(seed: int) -> None:
    assert not infeasible(*rows(seed, lambda rng: float(rng.uniform(0.01, 10))))


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 100))
def test_two_half_spaces_that_do_not_meet_are_infeasible(seed: int, gap: float) -> None:
    """a mu <= c and a mu >= c + gap |a|, whatever else there is."""
    a = np.random.default_rng(seed).standard_normal((1, 4))
    A, lower, upper = rows(seed, lambda _: 1.0)
    lower, upper = np.append(lower, [-np.inf, gap * np.linalg.norm(a)]), np.append(upper, [0.0, np.inf])
    assert infeasible(np.vstack([A, a, a]), lower, upper)


def test_fewer_rows_are_not_less_feasible_and_all_judges_see_all_ticks() -> None:
    walker, oracle = CBF_CLF.assembly(stones=1), CBF_CLF_ORACLE.assembly(stones=1)
    found = measure(walker, (walker, walker, oracle), 1)
    assert found.outcome == "walked"
    assert found.safety[0] == found.safety[1]
    assert all(0 <= safety <= every <= found.ticks for safety, every in zip(found.safety, found.all, strict=True))
    assert found.safety[0] == found.safety[2]  # at scale 1 there is nothing to correct


PARAMETERS = TrainingParameters(problem=RL_CLF_QP, seed=4, episodes=1)
ONE = training_job(PARAMETERS)  # nominal, so that nothing is learned yet


def test_a_training_is_made_once_and_logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trained = retrain([ONE], tmp_path, 1)
    about = read(trained.policy(ONE)).metadata
    assert (about.problem, about.training_seed, about.episodes) == (RL_CLF_QP.name, 4, 1)
    assert about.command == ONE.command
    assert read(trained.policy(ONE, 1)).version == read(trained.policy(ONE)).version
    (row,) = trained.episodes()
    assert (row.problem, row.seed, row.mass_scale, row.episode) == (RL_CLF_QP.name, 4, 2.0, 1)
    assert 0 < row.kept <= row.ticks
    assert row.transitions == row.kept == about.transitions
    assert read_log(tmp_path / "episodes.csv") == [row]
    monkeypatch.setattr(TrainingJob, "do", lambda *_: pytest.fail("trained again"))
    assert retrain([ONE], tmp_path, 1) == trained


@pytest.mark.parametrize("what", ["gait", "plant", "made_with.json"])
def test_a_training_does_not_go_on_with_another_robot_or_gait(tmp_path: Path, what: str) -> None:
    gait = tmp_path / "gait.yaml"
    load_gaits(ONE.controller.gait).save(gait)
    tuning, out = ONE.controller.model_copy(update={"gait": str(gait)}), tmp_path / "out"
    for _ in range(2):
        with training(out, PARAMETERS, tuning, ONE.plant):
            pass
    (out / CHECKPOINT).touch()  # of an episode
    plant, told = ONE.plant, "gait.yaml"
    if what == "gait":
        gait.write_text(gait.read_text() + "# a remark\n")
    elif what == "plant":
        plant, told = plant.model_copy(update={"mass_scale": 2.5}), "plant or controller"
    else:
        (out / what).write_text("{")
        told = what
    with pytest.raises(CheckpointError, match=f"begun with another .*{told}"), training(out, PARAMETERS, tuning, plant):
        pass


@pytest.mark.parametrize("quick", [True, False])
def test_what_is_shipped_is_trained_anew(quick: bool) -> None:
    made = recipes(quick)
    assert len(set(made)) == len(made)
    for name, recipe in SHIPPED.items():
        assert recipe in made
        about = read(policy_path(name)).metadata
        assert (about.problem, about.training_seed, about.plant["mass_scale"], about.episodes) == (
            *(recipe.parameters.problem.name, recipe.parameters.seed, recipe.plant.mass_scale),
            recipe.parameters.episodes,
        )
