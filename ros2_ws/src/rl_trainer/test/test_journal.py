"""Transitions come back from the journal as they were, whatever the controller observes."""

from dataclasses import fields

import numpy as np
import pytest
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_trainer.journal import from_records, to_records
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
    (after,) = from_records(to_records([before], PARAMETERS), PARAMETERS)
    for each in fields(Transition):
        assert np.array_equal(getattr(after, each.name), getattr(before, each.name)), each.name
