"""Transitions come back from the journal as they were, whatever the controller observes."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_trainer.checkpoint import line_of, read_journal, transitions_of
from rl_trainer.parameters import TrainingParameters
from rl_trainer.transitions import Doubt, Transition

PROBLEM = RL_CBF_CLF_QP
PARAMETERS = TrainingParameters(problem=PROBLEM)


def transition(observations: int) -> Transition:
    """With numbers of its own in every place."""
    rng = np.random.default_rng(observations)
    n = len(PROBLEM.quantities)
    shapes = {"observation": observations, "next_observation": observations, "beta": n, "nominal": n, "measured": n}
    numbers = {"problem", "tick", "step_index", "failed", "doubt", "alpha"}
    arrays = {f.name: rng.standard_normal(shapes.get(f.name, 4)) for f in fields(Transition) if f.name not in numbers}
    return Transition(
        problem=PROBLEM, tick=3, step_index=2, failed=False, doubt=Doubt.NONE, alpha=rng.random((n, 4)), **arrays
    )


@pytest.mark.parametrize("names", PROBLEM.observations[1:])
def test_an_observation_comes_back_with_or_without_a_step_length(names: tuple[str, ...]) -> None:
    before = transition(len(names))
    (after,), lines = transitions_of(line_of(before, PARAMETERS), PARAMETERS)
    assert lines == 1
    for each in fields(Transition):
        assert np.array_equal(getattr(after, each.name), getattr(before, each.name)), each.name


def test_numbers_that_are_not_finite_come_back(tmp_path: Path) -> None:
    before = replace(transition(15), nominal=np.array([np.nan, np.inf, -np.inf, -0.0, 1e-308]))
    ((after,), _) = transitions_of(line_of(before, PARAMETERS), PARAMETERS)
    assert after.nominal.tobytes() == before.nominal.tobytes()


def test_every_prefix_of_a_journal_has_the_lines_that_are_whole(tmp_path: Path) -> None:
    """As a kill leaves it; what is added afterwards is whole again."""
    line, path = line_of(transition(15), PARAMETERS), tmp_path / "journal"
    for cut in range(len(line)):
        path.write_bytes(line + line[:cut])
        is_whole = cut >= len(line) - 1
        assert len(read_journal(path, PARAMETERS)) == 1 + is_whole
        path.write_bytes(line[:cut] + line)
        assert len(read_journal(path, PARAMETERS)) == 1 + is_whole
        path.write_bytes(line[:cut])
        assert len(read_journal(path, PARAMETERS)) == is_whole
