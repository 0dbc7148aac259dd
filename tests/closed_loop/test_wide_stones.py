"""A gait library on five wide stones at twice the mass, beside the single gait and without barriers."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import episode, walk
from rl_trainer.rollout import Record

MakeAssembly = Callable[..., Assembly]
WIDE = {"l_min_distribution": "uniform", "l_min_mean": 0.375, "l_min_std": 0.05, "l_min_truncation": 2.5, "stones": 5}
PARAMETERS = {"objective": "pd_centred", "adaptation": "identification", "stone_margin": 0.007}


@pytest.fixture
def wide(make_assembly: MakeAssembly) -> Callable[..., Assembly]:
    """RL-CBF-CLF-QP without a policy, adapted, on stones of l_min in 0.25 to 0.50 m, with parameters of its own."""

    def make(**changes: Any) -> Assembly:
        parts = make_assembly("rl-cbf-clf-qp", mass_scale=2.0, **WIDE)
        return replace(parts, controller=parts.controller.model_copy(update={"gait": "wide", **PARAMETERS, **changes}))

    return make


def test_the_library_walks_and_the_single_gait_does_not(wide: Callable[..., Assembly]) -> None:
    assert walk(wide(), 0, seed=1).row.success
    assert not walk(wide(gait="stones_0350_084"), 0, seed=1).row.success


def test_aimed_at_the_near_edge_the_barriers_decide(wide: Callable[..., Assembly]) -> None:
    row = walk(wide(stone_aim=0.0), 0, seed=1).row
    assert row.success
    assert row.barrier_active_steps == row.steps
    assert not walk(wide(stone_aim=0.0, barrier_rows=False), 0, seed=1).row.success


def test_every_step_begins_without_error_towards_its_stone(wide: Callable[..., Assembly]) -> None:
    simulation, controller = wide().build()
    records: list[Record] = []
    episode(simulation, controller, 1, records.append)
    simulation.close()
    steps = [record.output.step_index for record in records]
    for index in set(steps):
        first = records[steps.index(index)]
        stone = first.state.preview
        assert stone is not None
        np.testing.assert_allclose(first.output.eta, 0.0, atol=1e-9)
        assert first.output.observation.shape == (16,)
        assert first.output.observation[15] == pytest.approx((stone.l_min + stone.l_max) / 2)
