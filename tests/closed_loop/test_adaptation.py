"""Objective and online adaptation on walks: who walks where the nominal controller falls, and what is learned."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rabbit_bringup.experiments.assembly import Assembly
from rabbit_bringup.experiments.evaluation import episode, walk
from rabbit_description.state import Array
from rl_trainer.rollout import Record

MakeAssembly = Callable[..., Assembly]
ADAPTIVE = {"objective": "pd_centred", "adaptation": "recursive_least_squares"}


def with_law(parts: Assembly, **changes: Any) -> Assembly:
    """The same with other parameters of the controller."""
    return replace(parts, controller=parts.controller.model_copy(update=changes))


def ticks(parts: Assembly, *seeds: int) -> list[list[Record]]:
    """Episodes of one plant and one controller, in order."""
    simulation, controller = parts.build()
    records: list[list[Record]] = [[] for _ in seeds]
    for seed, into in zip(seeds, records, strict=True):
        episode(simulation, controller, seed, into.append)
    simulation.close()
    return records


def torques(records: list[Record]) -> Array:
    """(n, 4), N m."""
    return np.array([record.output.torque for record in records])


@pytest.mark.parametrize("mass_scale", [0.5, 3.0])
def test_adaptation_walks_where_the_same_controller_without_it_falls(
    make_assembly: MakeAssembly, mass_scale: float
) -> None:
    parts = with_law(make_assembly("cbf-clf-qp", mass_scale=mass_scale, stones=5), **ADAPTIVE)
    assert walk(parts, 0, seed=1).row.success
    assert not walk(with_law(parts, adaptation="none"), 0, seed=1).row.success


def test_the_pd_centred_oracle_walks_at_half_the_mass_and_the_papers_does_not(make_assembly: MakeAssembly) -> None:
    parts = make_assembly("cbf-clf-qp", "oracle", mass_scale=0.5, stones=8)
    assert walk(with_law(parts, objective="pd_centred"), 0, seed=1).row.success
    assert not walk(parts, 0, seed=1).row.success


def test_an_exact_model_is_left_nearly_alone(make_assembly: MakeAssembly) -> None:
    """The rigid plant without lag is the model: what is learned is the error of differencing over a tick."""
    parts = make_assembly("cbf-clf-qp", plant="rigid", motor_lag=0.0, stones=5)
    (records,) = ticks(with_law(parts, **ADAPTIVE), 1)
    assert np.abs([record.output.effectiveness - np.eye(5) for record in records]).max() < 0.1
    assert np.median(np.abs([record.output.acceleration_residual for record in records])) < 1.0


def test_twice_the_mass_halves_the_effect_of_torques(make_assembly: MakeAssembly) -> None:
    parts = make_assembly("cbf-clf-qp", plant="rigid", motor_lag=0.0, mass_scale=2.0, stones=5)
    (records,) = ticks(with_law(parts, **ADAPTIVE), 1)
    last = records[-1].output
    swing = slice(3, 5)  # what the swing leg's torques do is most of what the walk excites
    assert np.diag(last.effectiveness)[swing] == pytest.approx([0.5, 0.5], abs=0.1)
    assert (last.objective, last.adaptation) == ("pd_centred", "recursive_least_squares")


def test_an_exact_policy_leaves_nothing_to_adapt(make_assembly: MakeAssembly) -> None:
    parts = make_assembly("cbf-clf-qp", "oracle", plant="rigid", motor_lag=0.0, mass_scale=2.0, stones=3)
    (records,) = ticks(with_law(parts, **ADAPTIVE), 1)
    assert np.abs([record.output.effectiveness - np.eye(5) for record in records]).max() < 0.1


def test_every_episode_begins_with_nothing_learned(make_assembly: MakeAssembly) -> None:
    parts = with_law(make_assembly("cbf-clf-qp", mass_scale=2.0, stones=2), **ADAPTIVE)
    _, second = ticks(parts, 1, 2)
    (alone,) = ticks(parts, 2)
    np.testing.assert_array_equal(torques(second), torques(alone))


def test_without_adaptation_nothing_is_adapted(make_assembly: MakeAssembly) -> None:
    (records,) = ticks(make_assembly("cbf-clf-qp", stones=1), 1)
    np.testing.assert_array_equal(records[-1].output.effectiveness, np.eye(5))
