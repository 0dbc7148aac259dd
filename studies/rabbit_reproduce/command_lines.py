"""The command of a user that does the same: `rabbit evaluate` for a scenario; options for what differs in a model."""

import shlex
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_experiments.evaluation import Scenario
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.weights import policy_path, shipped_policies


def evaluate_command(scenario: Scenario) -> str:
    """Every option that is not `rabbit evaluate`'s own default."""
    assembly = scenario.assembly
    tuning, plant = assembly.controller, assembly.simulation
    terrain = tuning.terrain
    usual = load_parameters("ours", controller=tuning.controller)
    usual_plant = SimulationParameters(motor_lag=EVALUATION_LAG, terrain=terrain)
    words = ["rabbit", "evaluate", "--controller", tuning.controller, *_policy(assembly)]
    words += changed_options(plant, usual_plant) + changed_options(tuning, usual, but=SimulationParameters)
    return shlex.join([*words, "--runs", str(scenario.runs), "--seed", str(scenario.seed), "--out", "DIR"])


def changed_options(model: BaseModel, usual: BaseModel, but: type[BaseModel] | None = None) -> list[str]:
    """Options of the fields that differ, `but` those another model has as well."""
    words: list[str] = []
    for name in type(model).model_fields:
        value: Any = getattr(model, name)
        if value == getattr(usual, name) or (but and name in but.model_fields):
            continue
        option = name.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{option}" if value else f"--no-{option}")
        else:
            words += [f"--{option}", _text(value)]
    return words


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return ",".join(map(_text, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _policy(assembly: Assembly) -> list[str]:
    own = assembly.controller.controller in shipped_policies() or not assembly.controller.learns
    if own and assembly.policy == resolve_policy(None, assembly.controller):
        return []
    name = Path(assembly.policy).stem
    if assembly.policy == str(policy_path(name)):
        return ["--policy", name]
    file, here = Path(assembly.policy), Path.cwd()
    return ["--policy", str(file.relative_to(here) if file.is_relative_to(here) else file)]
