"""Who walks, who falls, what the barriers promise; from nothing to a policy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_experiments.conditions import TRAINING_SCALE, TRAINING_SLACK_WEIGHT
from rabbit_experiments.evaluation import episode_seeds, walk
from rabbit_experiments.training_setup import training
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters
from rl_trainer.parameters import TrainingParameters
from walked import make_assembly, walked, with_law

TWICE = {"mass_scale": 2.0}


@pytest.mark.parametrize(
    ("controller", "policy", "plant"),
    [
        *(("clf-qp", "zero", {"plant": engine, "stones": 8}) for engine in ("mujoco", "pybullet", "rigid")),
        ("cbf-clf-qp", "zero", {"stones": 5}),
        *((name, "oracle", TWICE) for name in ("rl-clf-qp", "rl-cbf-clf-qp", "io-rl-clf-qp")),
        ("rl-cbf-clf-qp", "rl-cbf-clf-qp", {**TWICE, "stones": 20}),
        *(("robust-cbf-clf-qp", "zero", {"mass_scale": end, "stones": 6}) for end in (1.0, 2.0)),  # of its bounds
    ],
)
def test_who_walks(controller: str, policy: str, plant: dict[str, Any]) -> None:
    """The nominal controllers on their robot; at twice the mass the oracle, the shipped policy, the robust one."""
    assembly = make_assembly(controller, policy, **plant)
    result, steps = walk(assembly, 0, seed=1), assembly.simulation.stones
    row = result.row
    assert (row.outcome, row.steps, row.success) == ("walked", steps, True)
    assert row.ticks_normal_force_negative == row.qp_unanswered_ticks == 0
    assert len(result.tick_seconds) == row.ticks
    if assembly.simulation.terrain == "stones":
        assert row.stones == steps
        assert 0 < row.worst_margin < 0.025  # half a stone's width


@pytest.mark.parametrize(("controller", "eps"), [("clf-qp", 0.07), ("cbf-clf-qp", 0.04)])
def test_nominal_controller_falls_at_twice_the_mass(controller: str, eps: float) -> None:
    """On flat ground a CLF-QP of higher gain walks on a while; the authors' eps does not."""
    heavy = with_law(make_assembly(controller, **TWICE, stones=20), eps=eps)
    assert not any(walk(heavy, run, seed).row.success for run, seed in episode_seeds(1, 2).items())


def test_l1_tracks_better_than_the_clf_qp_at_a_mass_scale_of_1_2() -> None:
    """Over seeds; the friction cone is kept by both."""
    seeds = episode_seeds(1, 2)
    nominal, adaptive = (
        [walk(make_assembly(name, mass_scale=1.2, stones=8), run, seed).row for run, seed in seeds.items()]
        for name in ("clf-qp", "l1-clf-qp")
    )
    for plain, l1 in zip(nominal, adaptive, strict=True):
        assert l1.success
        assert l1.rms_y < plain.rms_y
        assert l1.max_force_ratio < 0.8


ROUNDING = 1e-9  # m


@pytest.mark.parametrize("plant", ["rigid", "pybullet"])
@pytest.mark.parametrize(
    ("controller", "policy", "mass_scale"),
    [("cbf-clf-qp", "zero", 1.0), ("rl-cbf-clf-qp", "oracle", 2.0), ("rl-cbf-clf-qp", "rl-cbf-clf-qp", 2.0)],
)
def test_every_step_begins_inside_and_the_foot_stays_within_the_margin(
    controller: str, policy: str, mass_scale: float, plant: str
) -> None:
    """With motors that lag, held torques and soft rows, B may be negative by less than the rows' margin."""
    parts = make_assembly(controller, policy, plant=plant, mass_scale=mass_scale, stones=10)
    outputs = [tick.output for tick in walked(parts, 9001)[0]]
    starts = np.flatnonzero(np.diff([output.step_index for output in outputs], prepend=-1))
    B = np.array([output.barriers for output in outputs])
    rate = np.array([output.barrier_rates for output in outputs])
    assert len(starts) == 10
    assert (B[starts] >= -ROUNDING).all()
    assert (rate[starts] + parts.controller.barrier_pole_1 * B[starts] >= 0).all()
    assert B.min() > -parts.controller.stone_margin


@pytest.mark.parametrize("plant", ["rigid", "pybullet"])
def test_with_exact_estimates_and_motors_that_do_not_lag_no_barrier_is_negative(plant: str) -> None:
    parts = make_assembly("rl-cbf-clf-qp", "oracle", plant=plant, **TWICE, stones=10, motor_lag=0.0)
    assert np.min([tick.output.barriers for tick in walked(parts, 9001)[0]]) >= -ROUNDING


STONES = 10
COURSES = episode_seeds(8001, 4)  # none of a training's, whose seeds are children of the training seed


@pytest.mark.slow
@pytest.mark.timeout(3600)  # a guard against hangs
def test_a_trained_policy_walks_at_least_four_times_as_many_stones_as_the_nominal_controller(tmp_path: Path) -> None:
    """Stones walked on the 4 courses when the threshold was fixed, by training seed.

    1: 10, 10, 10, 10    2: 10, 10, 10, 10    3: 10, 10, 10, 10    nominal: 1, 2, 1, 1

    After one episode, before any update, the policy walks 1, 2, 1, 1. Between episodes 4 and 7 the worst of the three
    walked 10, 1, 10, 10. A training takes some 45 s of processor time.
    """
    softer = load_parameters("ours", controller="rl-cbf-clf-qp", slack_weight=TRAINING_SLACK_WEIGHT)
    parameters = TrainingParameters(seed=1, episodes=6, walking_steps=STONES)
    plant = SimulationParameters(mass_scale=TRAINING_SCALE, stones=STONES, stop_at_miss=False)
    file = tmp_path / "policy.safetensors"
    with training(tmp_path, parameters, softer, plant) as (trainer, reports):
        list(reports)
        trainer.policy_file().write(file)
    learned, nominal = (
        [walk(parts, run, seed).row.stones for run, seed in COURSES.items()]
        for parts in (
            make_assembly("rl-cbf-clf-qp", str(file), mass_scale=TRAINING_SCALE, stones=STONES),
            make_assembly("cbf-clf-qp", mass_scale=TRAINING_SCALE, stones=STONES),
        )
    )
    assert sum(learned) >= 4 * sum(nominal), (learned, nominal)
