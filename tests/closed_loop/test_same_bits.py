"""A tick has the same bits in CasADi's virtual machine and as C, alone and beside threads; N: `test_batch.py`."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp.compiled import COMPILE
from rabbit_description.state import RobotState
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_trainer.rollout import Record, rollout

SEED, THREADS = 23, 2
FIELDS = "torque", "mu", "eta", "alpha", "beta", "margins", "slacks", "multipliers", "measured", "identified"
NAMES = ("clf-qp", "l1-clf-qp", "io-rl-clf-qp", "rl-clf-qp", "cbf-clf-qp", "rl-cbf-clf-qp", "robust-cbf-clf-qp", "best")
CONTROLLERS: dict[str, dict[str, Any]] = {
    **{name: {} for name in NAMES},
    **{"rl-cbf-clf-qp, exploring": {"sigma": 5.0}, "rl-cbf-clf-qp, osqp": {"qp_solver": "osqp"}},
}


def assembly_of(name: str, changes: dict[str, Any]) -> Assembly:
    kind = {} if name == "best" else {"controller": name.split(",")[0]}
    parameters = load_parameters("ours" if kind else "best", **{"qp_solver": "daqp", **kind, **changes})
    plant = SimulationParameters(plant="mujoco", mass_scale=2.0, stones=3, terrain=parameters.terrain)
    return Assembly(plant, parameters, resolve_policy(None, parameters))


def ticks(controller: Controller, states: Sequence[RobotState]) -> list[tuple[bytes, ...]]:
    controller.reset(SEED)
    outputs = [controller.step(state) for state in states]
    return [tuple(np.asarray(getattr(output, name)).tobytes() for name in FIELDS) for output in outputs]


@pytest.mark.parametrize(
    "name", [kind if kind == "cbf-clf-qp" else pytest.param(kind, marks=pytest.mark.thorough) for kind in CONTROLLERS]
)
def test_a_tick_has_the_same_bits_wherever_it_is_computed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assembly, records = assembly_of(name, CONTROLLERS[name]), list[Record]()
    monkeypatch.setenv(COMPILE, "0")
    simulation, virtual = assembly.build()
    rollout(simulation, virtual, SEED, records.append)
    states = [record.state for record in records]
    expected = ticks(virtual, states)
    assert len(set(expected)) > len(expected) // 2  # they differ from tick to tick
    monkeypatch.delenv(COMPILE)
    compiled = [assembly.make_controller() for _ in range(THREADS)]
    for controller in compiled:
        controller.compile(wait=True)
    assert ticks(compiled[0], states) == expected
    with ThreadPoolExecutor(THREADS) as pool:
        assert all(found == expected for found in pool.map(ticks, compiled, [states] * THREADS))
