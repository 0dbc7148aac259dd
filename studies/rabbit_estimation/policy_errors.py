"""How good a policy's estimates are: against the oracle's, the plant's true errors, at states of closed-loop walks.

At every tick more than 50 ms after an impact (or the start), policy and oracle are asked at the same state. Over all
these ticks, with mu as executed, each quantity has

    error        rms(alpha mu + beta - truth) / rms(truth)      0: exact, 1: no better than the zero policy
    alpha_r2     1 - sum |alpha - true|^2 / sum |true - mean true|^2, all four components together
    alpha_rms    rms(alpha - true), by component                beta_r2, beta_rms: likewise

Where the truth is zero, or does not vary, a ratio to it has no meaning and is left out. V is in units of |LgV| + 1 at
each tick; V_unscaled in 1/s.
"""

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import Array
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import ended, episode
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.scene import Scene
from rl_trainer.rollout import Record

from rabbit_estimation.estimation_errors import rms

SETTLED = 0.05  # s after an impact, from which a tick counts
ROUNDING = 1e-6  # what of a truth is no more than rounding, in the quantity's unit

Errors = dict[str, float | None]


class NoTicksError(ValueError):
    """No tick is late enough after an impact."""


def compare(assembly: Assembly, walker: str, seeds: Iterable[int]) -> dict[str, Any]:
    """Errors of the assembly's policy on walks of `walker`: `policy`, itself, or `oracle`.

    Returns:
        `walks`: seed, outcome, landings and ticks of each; `ticks`: how many count; `active_share`: of these, by row
        of the QP, that hold with equality; `quantities`: the errors of each, see `errors`.

    Raises:
        NoTicksError: no walk lasted long enough.
    """
    with_oracle = replace(assembly, policy="oracle")
    policy, oracle = assembly.make_policy(), with_oracle.make_policy()
    walks, ticks = [], []
    for seed in seeds:
        walk, seen = _walk(with_oracle if walker == "oracle" else assembly, seed)
        walks.append(walk)
        ticks += [tick for tick in seen if tick[0].step_time >= SETTLED]
    if not ticks:
        raise NoTicksError(f"no walk of the {walker} lasted {SETTLED} s")
    outputs, scenes = zip(*ticks, strict=True)
    parameters = assembly.controller
    nothing = Estimates.zero(len(parameters.problem.quantities), parameters.problem.inputs)
    cone = ("C2+", "C2-") if parameters.cone == "two_rows" else ("C2",)
    rows = ("CLF", "B1", "B2", "C1", *cone) if parameters.terrain == "stones" else ("CLF",)
    return {
        "walks": walks,
        "ticks": len(ticks),
        "active_share": {row: sum(row in output.active for output in outputs) / len(ticks) for row in rows},
        "quantities": errors(
            parameters.problem,
            [policy.estimate(scene, nothing) for scene in scenes],
            [oracle.estimate(scene, nothing) for scene in scenes],
            np.array([output.mu for output in outputs]),
            np.array([output.LgV for output in outputs]),
        ),
    }


def errors(
    problem: Problem, estimated: Sequence[Estimates], true: Sequence[Estimates], mu: Array, LgV: Array
) -> dict[str, Errors]:
    """The errors of each quantity, as above, over T ticks; `mu`, `LgV` (T, 4). None: has no meaning."""
    guess, truth = _stacked(estimated), _stacked(true)
    errors = {name: _errors(guess[:, i], truth[:, i], mu) for i, name in enumerate(problem.quantities)}
    if problem.has_clf:
        unit = np.linalg.norm(LgV, axis=1, keepdims=True) + 1
        errors["V_unscaled"] = errors["V"]
        errors["V"] = _errors(guess[:, 0] / unit, truth[:, 0] / unit, mu)
    return errors


def _walk(assembly: Assembly, seed: int) -> tuple[dict[str, Any], list[tuple[ControllerOutput, Scene]]]:
    """One run from fresh parts: how it went, and of each tick what the controller did and what it saw."""
    simulation, controller = assembly.build()
    ticks: list[Record] = []
    scenes: list[Scene] = []
    with closing(simulation):
        fault = episode(simulation, controller, seed, ticks.append, lambda _: scenes.append(controller.scene))
    outcome, landings = ended(simulation, fault, ticks), len(simulation.landings)
    about = {"seed": seed, "outcome": outcome, "landings": landings, "ticks": len(ticks)}
    return about, list(zip([tick.output for tick in ticks], scenes, strict=True))


def _stacked(estimates: Sequence[Estimates]) -> Array:
    """Alpha and beta side by side, (T, n, 5)."""
    return np.array([np.column_stack([estimate.alpha, estimate.beta]) for estimate in estimates])


def _errors(guess: Array, truth: Array, mu: Array) -> Errors:
    """The errors of one quantity; `guess` and `truth` (T, 5) are alpha and beta."""
    wrong, with_one = guess - truth, np.column_stack([mu, np.ones(len(mu))])
    size = rms((truth * with_one).sum(axis=1))
    alpha, beta = slice(-1), slice(-1, None)
    return {
        "error": None if size < ROUNDING else rms((wrong * with_one).sum(axis=1)) / size,
        "alpha_r2": _r2(wrong[:, alpha], truth[:, alpha]),
        "beta_r2": _r2(wrong[:, beta], truth[:, beta]),
        "alpha_rms": rms(wrong[:, alpha]),
        "beta_rms": rms(wrong[:, beta]),
    }


def _r2(wrong: Array, truth: Array) -> float | None:
    """Share of the truth's variation that is explained; `wrong` and `truth` (T, m)."""
    spread = rms(truth - truth.mean(axis=0))
    return None if spread < ROUNDING else 1 - (rms(wrong) / spread) ** 2
