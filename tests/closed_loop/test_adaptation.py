"""Objective and online adaptation on walks: who walks where the nominal controller falls, and what is learned."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import episode, walk
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.identified_robot import KNOWN
from rl_cbf_clf_controller.parameters import load_parameters
from rl_trainer.rollout import Record

MakeAssembly = Callable[..., Assembly]
ADAPTIVE = {"objective": "pd_centred", "adaptation": "identification"}


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


@pytest.mark.parametrize("mass_scale", [0.5, 3.0])
def test_adaptation_walks_where_the_same_controller_without_it_falls(
    make_assembly: MakeAssembly, mass_scale: float
) -> None:
    parts = with_law(make_assembly("cbf-clf-qp", mass_scale=mass_scale, stones=5), **ADAPTIVE)
    assert walk(parts, 0, seed=1).row.success
    assert not walk(with_law(parts, adaptation="none"), 0, seed=1).row.success


def test_a_payload_is_walked_and_found(make_assembly: MakeAssembly) -> None:
    parts = with_law(make_assembly("cbf-clf-qp", payload=72.0, stones=5), gait="stones_0350_084", **ADAPTIVE)
    assert walk(parts, 0, seed=1).row.success
    (records,) = ticks(parts, 1)
    assert records[-1].output.identified[0] == pytest.approx(84.0, rel=0.03)


def test_bent_links_are_walked_and_found(make_assembly: MakeAssembly) -> None:
    bent = make_assembly("cbf-clf-qp", mass_scale=2.0, link_bend=0.05, stones=5)
    parts = with_law(bent, gait="stones_0350_084", **ADAPTIVE)
    assert walk(parts, 0, seed=1).row.success
    assert not walk(with_law(parts, adaptation="none"), 0, seed=1).row.success
    (records,) = ticks(parts, 1)
    assert records[-1].output.identified[KNOWN.index("hip_offset")] == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize("seed", [1, 2])
def test_ground_that_gives_way_is_no_wrong_angle(seed: int) -> None:
    """The nominal controller walks this ground; `best` found offsets of some hundredths of a rad, and fell."""
    soft = SimulationParameters(mass_scale=2.0, ground_stiffness=5e4, ground_damping=2e3, motor_lag=0.004, stones=10)
    records: list[Record] = []
    assert walk(Assembly(soft, load_parameters("best"), "zero"), 0, seed, records.append).row.success
    offsets = slice(KNOWN.index("hip_offset"), KNOWN.index("knee_offset") + 1)
    assert not records[-1].output.identified[offsets].any()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noisy_rates_do_not_make_the_legs_light(seed: int) -> None:
    """Noise in the regressors pulls what is found towards none, and does not average out."""
    plant = SimulationParameters(payload=40.0, velocity_noise=0.2, motor_lag=0.004, stones=8)
    parts = Assembly(plant, load_parameters("best", qp_solver="daqp"), "zero")
    records: list[Record] = []
    assert walk(parts, 0, seed, records.append).row.success
    assert records[-1].output.identified[[4, 8]] == pytest.approx([6.8, 3.2], rel=0.2)


def test_an_exact_model_is_left_nearly_alone(make_assembly: MakeAssembly) -> None:
    """The rigid plant without lag is the model: what is learned is the error of means over a tick."""
    parts = make_assembly("cbf-clf-qp", plant="rigid", motor_lag=0.0, stones=5)
    (records,) = ticks(with_law(parts, **ADAPTIVE), 1)
    known = dict(zip(KNOWN, records[-1].output.identified, strict=True))
    assert [known[f"{link}_m"] for link in ("torso", "thigh", "shin")] == pytest.approx([12.0, 6.8, 3.2], rel=0.03)
    assert known["motor_gain"] == pytest.approx(1.0, abs=0.02)
    assert [known["hip_offset"], known["knee_offset"]] == pytest.approx([0.0, 0.0], abs=0.003)


def test_a_robot_that_is_not_explained_gives_way_to_the_one_that_the_base_says() -> None:
    """Joints whose friction remembers are no masses, which the base's rows say; without doubt the walk ends."""
    believing = load_parameters("best", doubt_eps=0.0, qp_solver="daqp")
    plant = SimulationParameters(mass_scale=1.5, hysteresis=50.0, motor_lag=0.004, stones=8)
    parts = Assembly(plant, believing, "zero")
    assert not walk(parts, 0, seed=1).row.success
    doubting = with_law(parts, doubt_eps=load_parameters("best").doubt_eps)
    (records,) = ticks(doubting, 1)
    assert walk(doubting, 0, seed=1).row.success
    known = dict(zip(KNOWN, records[-1].output.identified, strict=True))
    assert known["doubt"] > 0.3
    assert known["torso_m"] + 2 * known["thigh_m"] + 2 * known["shin_m"] == pytest.approx(1.5 * 32, rel=0.01)
