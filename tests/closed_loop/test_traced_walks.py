"""On the states of whole walks, generated and traced code gives the torque of pinocchio and numpy."""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp import tracing
from rabbit_description.gait import load_gaits
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller import generated_model, generated_outputs
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.generated.traces import compiled_trace
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ActorPolicy, Policy, ZeroPolicy
from rl_cbf_clf_controller.weights import policy_path, read
from rl_trainer.rollout import Record, rollout

SEED = 91_400
CONTROLLERS = {
    "rl-cbf-clf-qp": {},
    "cbf-clf-qp": {"adaptation": "identification", "objective": "pd_centred"},
    "rl-clf-qp": {},
    "l1-clf-qp": {},
    "io-rl-clf-qp": {},
    "robust-cbf-clf-qp": {},
}


def make(name: str) -> Controller:
    parameters = ControllerParameters.model_validate({"controller": name, **CONTROLLERS[name]})
    policy: Policy = ZeroPolicy(parameters.problem)
    if parameters.learns:
        policy = ActorPolicy(read(Path(policy_path(name))))
    return Controller(parameters, load_gaits(parameters.gait), policy)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_torques_are_the_reference_paths(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    walked: list[Record] = []
    fast = make(name)
    fast.rehearse()  # at the gait's start, where all outputs are 0
    assert fast.model_terms == "generated code, traced by CasADi"
    terrain = fast.parameters.terrain
    plant = SimulationParameters.model_validate(
        {"mass_scale": 1.3, "stones": 4, "terrain": terrain, "motor_lag": 0.004}
    )
    with closing(Simulation(plant, load_gaits(fast.parameters.gait))) as simulation:
        rollout(simulation, fast, SEED, walked.append)
    monkeypatch.setattr(tracing, "ENABLED", False)
    monkeypatch.setattr(generated_model, "load_library", lambda: None)
    monkeypatch.setattr(generated_outputs, "load_library", lambda: None)
    reference = make(name)
    assert reference.model_terms == "pinocchio, numpy"
    reference.reset(SEED)
    compared = 0
    for record in walked:
        found, expected = record.output, reference.step(record.state)
        if found.active == expected.active:
            compared += 1
            np.testing.assert_allclose(found.torque, expected.torque, rtol=0, atol=1e-6)
    assert compared > 0.9 * len(walked) > 50


@pytest.mark.parametrize("name", ["rl-cbf-clf-qp", "rl-clf-qp", "l1-clf-qp", "io-rl-clf-qp", "robust-cbf-clf-qp"])
def test_a_rehearsed_controller_is_traced_and_walks_as_another(name: str) -> None:
    """Bit for bit: a recording replays whatever its controller has computed before."""
    rehearsed, other = make(name), make(name)
    rehearsed.rehearse()
    assert not any(traced.reason for traced in (rehearsed._terms._derived, rehearsed.recipe.programme))
    plant = SimulationParameters.model_validate({"mass_scale": 1.2, "stones": 2, "terrain": other.parameters.terrain})
    with closing(Simulation(plant, load_gaits(other.parameters.gait))) as simulation:
        walked: list[Record] = []
        rollout(simulation, other, SEED, walked.append)
    rehearsed.reset(SEED)
    assert len(walked) > 30
    for record in walked:
        assert rehearsed.step(record.state).torque.tolist() == record.output.torque.tolist()


def test_compiled_traces_have_the_same_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that `make build` has compiled; beside them CasADi's virtual machine."""
    made: list[bool] = []

    def looked_up(function: Any) -> Any:
        found = compiled_trace(function)
        made.append(found is not function)
        return found

    ticks: list[list[list[float]]] = []
    for lookup in (looked_up, tracing.as_it_is):
        monkeypatch.setattr(tracing, "compiled", lookup)
        controller = make("rl-cbf-clf-qp")
        controller.rehearse()
        plant = SimulationParameters(mass_scale=2.0, stones=2)
        with closing(Simulation(plant, load_gaits(controller.parameters.gait))) as simulation:
            walked: list[Record] = []
            rollout(simulation, controller, SEED, walked.append)
        ticks.append([record.output.torque.tolist() for record in walked])
    assert len(made) >= 4
    assert all(made)
    assert ticks[0] == ticks[1]
