"""The tick's length is a parameter: what is said of times holds at every rate, and two rates do not mix."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from rabbit_common.ros.conversions import header
from rabbit_description.gait import load_gaits
from rabbit_estimator.parameters import EstimatorParameters
from rabbit_experiments.assembly import Assembly
from rabbit_sim.actuation import Actuation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbation import Memory
from rabbit_sim.perturbations.pushes import Pushes
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError, policy_path, read
from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer
from walked import walked

TICKS = (0.01, 0.005, 0.002, 0.001)  # s
FAST = ControllerParameters(controller="rl-cbf-clf-qp", tick_seconds=0.005)


@pytest.mark.parametrize("model", [SimulationParameters, ControllerParameters, TrainingParameters, EstimatorParameters])
@pytest.mark.parametrize(("wrong", "words"), [(0.0015, "a multiple of 0.001 s"), (0.02, "0.01"), (5e-4, "0.001")])
def test_what_is_no_tick_is_refused_at_the_door(model: Any, wrong: float, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        model(tick_seconds=wrong)


def test_a_policy_of_another_rate_is_refused() -> None:
    file, gait = read(policy_path("rl-cbf-clf-qp")), load_gaits(FAST.gait)
    assert file.metadata.trained_tick == 0.01
    with pytest.raises(PolicyFileError, match=r"trained with tick_seconds = 0\.01; this controller has 0\.005"):
        fitted(file, FAST, gait)
    faster = PolicyFile(file.metadata.model_copy(update={"tick_seconds": 0.005}), file.arrays)
    assert fitted(faster, FAST, gait).version != file.version
    with pytest.raises(PolicyFileError, match=r"trained with tick_seconds = 0\.005; this controller has 0\.01"):
        fitted(faster, ControllerParameters(controller="rl-cbf-clf-qp"), gait)


def test_a_training_goes_on_from_a_policy_of_its_own_rate_alone() -> None:
    """What it learns would be called a policy of the new rate."""
    slow, fast = (TrainingParameters(tick_seconds=tick, hidden1=4, hidden2=4) for tick in (0.01, 0.005))
    given = Trainer(slow).policy_file()
    Trainer(slow).start_from(given)
    with pytest.raises(PolicyFileError, match=r"trained_tick = 0\.01; this training has 0\.005"):
        Trainer(fast).start_from(given)


def test_stamps_say_the_time_at_every_rate() -> None:
    stamps = [header(round(1.5 / tick), tick).stamp for tick in TICKS]
    assert [(stamp.sec, stamp.nanosec) for stamp in stamps] == [(1, 500_000_000)] * 4


@pytest.mark.parametrize("tick", TICKS)
@pytest.mark.parametrize(
    "motors", [{"motor_lag": 0.008}, {"torque_delay": 0.013}, {"torque_rate": 4000.0}, {"motor_frequency": 20.0}]
)
def test_motors_do_not_know_the_rate(motors: dict[str, float], tick: float) -> None:
    """Under a command that changes every 10 ms."""
    rng = np.random.default_rng(2)
    commands = rng.uniform(-50, 50, (6, 4))

    def given(tick: float) -> Any:
        actuation, times = Actuation(SimulationParameters(tick_seconds=tick, **motors)), round(0.01 / tick)
        return np.concatenate([actuation.advance(command) for command in np.repeat(commands, times, axis=0)])

    np.testing.assert_allclose(given(tick), given(0.01), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("tick", [*TICKS, 0.003, 0.007])
def test_a_push_has_its_impulse_at_every_rate(tick: float) -> None:
    pushes, memory = Pushes(push=12.0, push_interval=0.5), Memory(parameters=SimulationParameters(tick_seconds=tick))
    forces = np.concatenate([pushes.force(memory, number) for number in range(round(0.9 / tick))])
    assert abs(forces.sum()) * 0.001 == pytest.approx(12.0)


@pytest.mark.parametrize(("engine", "tick"), [("rigid", 0.01), ("rigid", 0.002), ("mujoco", 0.001)])
def test_the_robot_walks_and_is_identified_at_every_rate(engine: str, tick: float) -> None:
    plant = SimulationParameters(plant=engine, mass_scale=1.5, stones=4, stop_at_miss=False, tick_seconds=tick)
    best = load_parameters("best", tick_seconds=tick)
    records, simulation = walked(Assembly(plant, best, "zero"), 7)
    assert (len(simulation.landings), simulation.outcome.value) == (4, "walked")
    found, nominal = records[-1].output.identified, records[0].output.identified
    masses = [0, 4, 8]  # of torso, thighs and shins
    share = (found[masses] * [1, 2, 2]).sum() / (nominal[masses] * [1, 2, 2]).sum()
    assert share == pytest.approx(1.5, rel=0.05)
    assert len(records) * tick == pytest.approx(1.6, abs=0.5)  # s
