"""Who walks, who falls, and that a seed decides it all."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.evaluation import episode_seeds, walk
from rl_cbf_clf_controller.parameters import load_parameters

MakeAssembly = Callable[..., Assembly]
TWICE = 2.0


@pytest.mark.parametrize("plant", ["mujoco", "pybullet", "rigid"])
def test_nominal_controller_walks_on_flat_ground(make_assembly: MakeAssembly, plant: str) -> None:
    row = walk(make_assembly("clf-qp", stones=8, plant=plant), 0, seed=1).row
    assert (row.outcome, row.steps, row.success) == ("walked", 8, True)
    assert row.ticks_normal_force_negative == 0


def test_nominal_controller_walks_on_stones(make_assembly: MakeAssembly) -> None:
    result = walk(make_assembly("cbf-clf-qp", stones=5), 0, seed=1)
    assert result.row.success
    assert result.row.stones == 5
    assert 0 < result.row.worst_margin < 0.025  # half a stone's width
    assert result.row.qp_unanswered_ticks == 0
    assert len(result.tick_seconds) == result.row.ticks


@pytest.mark.parametrize(("controller", "eps"), [("clf-qp", 0.07), ("cbf-clf-qp", 0.04)])
def test_nominal_controller_falls_at_twice_the_mass(make_assembly: MakeAssembly, controller: str, eps: float) -> None:
    """On flat ground a CLF-QP of higher gain walks on a while; the authors' eps does not."""
    heavy = make_assembly(controller, mass_scale=TWICE, stones=20)
    heavy = replace(heavy, controller=heavy.controller.model_copy(update={"eps": eps}))
    assert not any(walk(heavy, run, seed).row.success for run, seed in episode_seeds(1, 2).items())


@pytest.mark.parametrize("controller", ["rl-clf-qp", "rl-cbf-clf-qp", "io-rl-clf-qp"])
def test_oracle_walks_at_twice_the_mass(make_assembly: MakeAssembly, controller: str) -> None:
    assert walk(make_assembly(controller, "oracle", mass_scale=TWICE), 0, seed=1).row.success


def test_the_shipped_policy_walks_at_twice_the_mass(make_assembly: MakeAssembly) -> None:
    policy = resolve_policy(None, load_parameters("ours", controller="rl-cbf-clf-qp"))
    row = walk(make_assembly("rl-cbf-clf-qp", policy, mass_scale=TWICE, stones=20), 0, seed=1).row
    assert row.success
    assert row.ticks_normal_force_negative == 0


@pytest.mark.parametrize("controller", ["rl-clf-qp", "io-rl-clf-qp"])
def test_the_shipped_policies_walk_on_flat_ground(make_assembly: MakeAssembly, controller: str) -> None:
    policy = resolve_policy(None, load_parameters("ours", controller=controller))
    assert walk(make_assembly(controller, policy, mass_scale=TWICE, stones=10), 0, seed=1).row.success


def test_l1_tracks_better_than_the_clf_qp_at_a_mass_scale_of_1_2(make_assembly: MakeAssembly) -> None:
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


def test_the_robust_controller_walks_at_both_ends_of_its_bounds(make_assembly: MakeAssembly) -> None:
    for scale in (1.0, TWICE):
        assert walk(make_assembly("robust-cbf-clf-qp", mass_scale=scale, stones=6), 0, seed=1).row.success
