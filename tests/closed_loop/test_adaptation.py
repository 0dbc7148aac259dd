"""Who walks where the nominal controller falls, and what is learned: masses, slopes, heights, delays, wide stones."""

from dataclasses import replace
from typing import Any

import pytest
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.evaluation import walk
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.identified_robot import KNOWN
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_trainer.rollout import Record, rollout
from walked import make_assembly, with_law

ADAPTIVE = {"objective": "pd_centred", "adaptation": "identification"}
BEST = load_parameters("best")
WITHOUT_SLOPES = load_parameters("best", gait="paper_stones")
SEED = 3


def found_by(parts: Assembly, seed: int = 1) -> dict[str, float]:
    """What is known in the end of a course, which is walked."""
    records: list[Record] = []
    assert walk(parts, 0, seed, records.append).row.success
    return dict(zip(KNOWN, records[-1].output.identified, strict=True))


def stones(controller: ControllerParameters, **plant: object) -> Assembly:
    """A course of ten at mass scale 2."""
    plant = {"mass_scale": 2.0, "motor_lag": 0.004, "terrain": "stones", "stones": 10, **plant}
    return Assembly(SimulationParameters.model_validate(plant), controller, resolve_policy(None, controller))


@pytest.mark.parametrize("mass_scale", [0.5, 3.0])
def test_adaptation_walks_where_the_same_controller_without_it_falls(mass_scale: float) -> None:
    parts = with_law(make_assembly("cbf-clf-qp", mass_scale=mass_scale, stones=5), **ADAPTIVE)
    assert walk(parts, 0, seed=1).row.success
    assert not walk(with_law(parts, adaptation="none"), 0, seed=1).row.success


def test_a_payload_is_walked_and_found() -> None:
    parts = with_law(make_assembly("cbf-clf-qp", payload=72.0, stones=5), gait="stones_0350_084", **ADAPTIVE)
    assert found_by(parts)["torso_m"] == pytest.approx(84.0, rel=0.03)


def test_bent_links_are_walked_and_found() -> None:
    bent = make_assembly("cbf-clf-qp", mass_scale=2.0, link_bend=0.05, stones=5)
    parts = with_law(bent, gait="stones_0350_084", **ADAPTIVE)
    assert found_by(parts)["hip_offset"] == pytest.approx(0.05, abs=0.005)
    assert not walk(with_law(parts, adaptation="none"), 0, seed=1).row.success


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("controller", "stiffness", "damping"), [("cbf-clf-qp", 5e4, 2e3), ("clf-qp", 1.1e4, 7e3)])
def test_ground_that_gives_way_is_no_wrong_angle(controller: str, stiffness: float, damping: float, seed: int) -> None:
    """The nominal controller walks these grounds; `best` found offsets of some hundredths of a rad, and fell."""
    best = load_parameters("best", "stones" if controller == "cbf-clf-qp" else "flat", controller=controller)
    soft = stones(best, terrain=best.terrain, ground_stiffness=stiffness, ground_damping=damping)
    known = found_by(soft, seed)
    assert (known["hip_offset"], known["knee_offset"]) == (0, 0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noisy_rates_do_not_make_the_legs_light(seed: int) -> None:
    """Noise in the regressors pulls what is found towards none, and does not average out."""
    plant = {"mass_scale": 1.0, "payload": 40.0, "velocity_noise": 0.2, "stones": 8}
    known = found_by(stones(load_parameters("best", qp_solver="daqp"), **plant), seed)
    assert [known["thigh_m"], known["shin_m"]] == pytest.approx([6.8, 3.2], rel=0.2)


def test_an_exact_model_is_left_nearly_alone() -> None:
    """The rigid plant without lag is the model: what is learned is the error of means over a tick."""
    known = found_by(with_law(make_assembly("cbf-clf-qp", plant="rigid", motor_lag=0.0, stones=5), **ADAPTIVE))
    assert [known[f"{link}_m"] for link in ("torso", "thigh", "shin")] == pytest.approx([12.0, 6.8, 3.2], rel=0.03)
    assert known["motor_gain"] == pytest.approx(1.0, abs=0.02)
    assert [known["hip_offset"], known["knee_offset"]] == pytest.approx([0.0, 0.0], abs=0.003)


def test_a_robot_that_is_not_explained_gives_way_to_the_one_that_the_base_says() -> None:
    """Joints whose friction remembers are no masses, which the base's rows say; without doubt the walk ends."""
    doubting = stones(load_parameters("best", qp_solver="daqp"), mass_scale=1.5, hysteresis=50.0, stones=8)
    assert not walk(with_law(doubting, doubt_eps=0.0), 0, seed=1).row.success
    known = found_by(doubting)
    assert known["doubt"] > 0.3
    assert known["torso_m"] + 2 * known["thigh_m"] + 2 * known["shin_m"] == pytest.approx(1.5 * 32, rel=0.01)


@pytest.mark.parametrize("plant", [{"slope": 2.0}, {"stone_height": 0.02}], ids=str)
def test_best_walks_where_gaits_for_level_ground_fall(plant: dict[str, float]) -> None:
    assert walk(stones(BEST, **plant), 0, SEED).row.success
    assert not walk(stones(WITHOUT_SLOPES, **plant), 0, SEED).row.success


def test_late_torques_need_the_prediction() -> None:
    """With it at least 8 of 10 courses are walked; without it at most half, if the robot found is always believed."""
    believing = load_parameters("best", prediction=False, doubt_eps=0.0)
    for controller, least, most in ((BEST, 8, 10), (believing, 0, 5)):
        walked = sum(walk(stones(controller, torque_delay=0.008), 0, SEED + run).row.success for run in range(10))
        assert walked in range(least, most + 1)


@pytest.mark.parametrize("slope", [-2.7, 1.5])
def test_best_walks_a_slope_that_its_sensors_see_as_other_heights(slope: float) -> None:
    """A lab's sensors measure the pitch from the vertical, so each landing is lower or higher than the gait's."""
    on_flat = load_parameters("best", controller="rl-clf-qp")
    assert walk(stones(on_flat, terrain="flat", slope=slope, sensors="lab"), 0, SEED).row.success


def settled(slope: float) -> float:
    """The slope, degrees, that steps on flat ground of such a `slope` are made for in the end, with exact estimates."""
    unadapted = {"adaptation": "none", "prediction": False, "doubt_eps": 0.0}
    controller = load_parameters("best", controller="rl-clf-qp", **unadapted)
    parts = replace(stones(controller, terrain="flat", slope=slope, stones=30, mass_scale=1.0), policy="oracle")
    simulation, built = parts.build()
    found: list[float] = []
    rollout(simulation, built, SEED, lambda record: found.append(float(built.steps.slopes[0])))
    simulation.close()
    return sum(found[-500:]) / 500


def test_the_slope_of_the_steps_follows_the_true_one() -> None:
    """But for an offset, which is what speed the motors' lag and the ground's give cost on level ground."""
    level = settled(0.0)
    assert abs(level) < 1.0
    for slope in (1.5, -3.0):
        assert settled(slope) - level == pytest.approx(slope, abs=0.3)


WIDE = {"l_min_distribution": "uniform", "l_min_mean": 0.375, "l_min_std": 0.05, "l_min_truncation": 2.5, "stones": 5}
PARAMETERS = {**ADAPTIVE, "stone_margin": 0.007, "gait": "wide"}


def wide(**changes: Any) -> Assembly:
    """RL-CBF-CLF-QP without a policy, adapted, on stones of l_min in 0.25 to 0.50 m, with parameters of its own."""
    return with_law(make_assembly("rl-cbf-clf-qp", mass_scale=2.0, **WIDE), **{**PARAMETERS, **changes})


def test_the_library_walks_and_the_single_gait_does_not() -> None:
    assert walk(wide(), 0, seed=1).row.success
    assert not walk(wide(gait="stones_0350_084"), 0, seed=1).row.success


def test_aimed_at_the_near_edge_the_barriers_decide() -> None:
    row = walk(wide(stone_aim=0.0), 0, seed=1).row
    assert row.success
    assert row.barrier_active_steps == row.steps
    assert not walk(wide(stone_aim=0.0, barrier_rows=False), 0, seed=1).row.success
