"""The operator of a soak does each of its operations at a walking graph, and knows a wrong answer."""

import json
from pathlib import Path
from typing import Any

import pytest
from rabbit_campaigns.ros.operator import Operator
from rabbit_campaigns.soak_operations import KINDS, LATCHED, Operation, Operations, unfit_policy
from rabbit_experiments.tables import read_rows
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.weights import policy_path

from .conftest import SHORT

PARAMETERS = ControllerParameters(controller="rl-cbf-clf-qp")
GOOD = policy_path("rl-cbf-clf-qp")


@pytest.fixture
def walking(make_world: Any) -> Any:
    world = make_world("soak")
    world.start("simulator", **SHORT, episodes=1000, mass_scale=2.0, pace=1.0)
    world.start("controller", controller=PARAMETERS.controller, policy=str(GOOD))
    world.go()
    return world


@pytest.mark.timeout(900)
def test_every_operation_is_answered_as_expected(walking: Any, tmp_path: Path) -> None:
    operator = Operator(walking.namespace, tmp_path, (GOOD, unfit_policy(PARAMETERS)), 1.0, seed=3)
    with Operations(operator, tmp_path, every=0.5, seed=3) as operations:
        for half_seconds in range(LATCHED + len(KINDS) + 6):
            walking.spin(0.1)
            operations(0.5 * half_seconds)
    rows = read_rows(tmp_path / "operations.csv", Operation)
    assert {row.kind for row in rows} == set(KINDS)
    assert all(row.expected for row in rows), json.dumps([row.__dict__ for row in rows if not row.expected])


@pytest.mark.timeout(900)
def test_what_is_answered_wrongly_is_found(walking: Any, tmp_path: Path) -> None:
    swapped = (unfit_policy(PARAMETERS), GOOD)
    operator = Operator(walking.namespace, tmp_path, swapped, 1.0, seed=3)
    operator.patience = 3.0
    try:
        assert [operator.do(kind)[2] for kind in ("good policy", "unfit policy", "pause")] == [False, False, True]
    finally:
        operator.close()
