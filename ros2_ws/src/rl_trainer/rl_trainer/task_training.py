"""Learning on a task: what is learned and in which units, measured from a few rides, and the training itself."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array
from rabbit_description.task import ControlTask
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy
from rl_cbf_clf_controller.problem import LEAST, QUANTILE, ROOM, Problem
from rl_cbf_clf_controller.task_controller import NOMINAL, ORACLE

from rl_trainer.systems import EpisodePlan, TrainingParameters, learn
from rl_trainer.task_episode import Rider
from rl_trainer.transitions import Transition

RIDES = 3  # of the nominal controller and of the oracle, each
SLOW = {"actor_rate": 6e-4, "critic_rate": 1e-3, "polyak": 3e-3, "batch": 160, "hidden1": 64, "hidden2": 64}
SCHEDULE = {"sigma_factors": (1,), "nominal_episodes": 1, "updates_per_tick": 0, "updates_least": 600, "episodes": 5}


def measured_problem(task: ControlTask, seed: int) -> Problem:
    """What is learned on a task, with the units of observations, estimates and errors.

    Rides of the nominal controller and of the oracle show them: an observation has its mean and deviation, an estimate
    `ROOM` times the greatest that the oracle has, an error the root of its mean square under the nominal model.
    """
    rider = Rider(task)
    alphas, betas, errors, read, mus = list[Array](), list[Array](), list[Array](), list[Array](), list[Array]()
    for i, controller in enumerate((NOMINAL, ORACLE) * RIDES):
        ride = rider.ride(controller, seed * 1000 + i)
        for moment in ride.moments:
            read.append(moment.seen.observation)
            mus.append(np.asarray(moment.mu))
            if controller == ORACLE and moment.estimates:
                alpha, beta = _greatest(moment.estimates, rider.problem.has_clf)
                alphas.append(alpha)
                betas.append(beta)
        if controller == NOMINAL:
            errors += [_error(each, rider.problem.has_clf) for each in rider.ticks.transitions]
    means, deviations = np.mean(read, axis=0).tolist(), _floored(np.std(read, axis=0))
    alpha_scale, beta_scale = (_floored(ROOM * np.quantile(each, QUANTILE, axis=0)) for each in (alphas, betas))
    return replace(
        rider.problem,
        units=tuple(zip(rider.problem.observation, means, deviations, strict=True)),
        alpha_scale=alpha_scale,
        beta_scale=beta_scale,
        error_scale=_floored(np.sqrt(np.mean(np.square(errors), axis=0))),
        mu_unit=max(float(np.std(mus)), LEAST),
    )


def _greatest(estimates: Estimates, has_clf: bool) -> tuple[Array, Array]:
    """The greatest |alpha| and |beta| (n,) of each quantity; of V those of the outputs, which LgV multiplies."""
    found = np.abs(np.column_stack([estimates.alpha, estimates.beta]))
    if has_clf and estimates.output_error is not None:
        found[0] = np.abs(estimates.output_error).max(axis=0)
    return found[:, :-1].max(axis=1), found[:, -1]


def _error(transition: Transition, has_clf: bool) -> Array:
    """Of each quantity; of V over |LgV| + 1, as the reward has it."""
    error: Array = np.array(transition.error)
    if has_clf:
        error[0] /= np.linalg.norm(transition.LgV) + 1
    return error


def _floored(values: Array) -> tuple[float, ...]:
    return tuple(np.maximum(values, LEAST).tolist())


def train(
    task: ControlTask, seed: int, say: Callable[[str], object] = print, **changes: Any
) -> tuple[LearnedPolicy, Problem]:
    """Ride with the present estimates and noise, learn from what was measured, repeat; the policy and what it learned.

    `changes`: of `TrainingParameters`.
    """
    parameters = training_parameters(task, seed, **changes)
    rider = Rider(task, parameters.problem)

    def ride(policy: LearnedPolicy, plan: EpisodePlan) -> None:
        rider.ride(policy, plan.seed, plan.sigma)

    return learn(parameters, rider.ticks, ride, say), parameters.problem


def training_parameters(task: ControlTask, seed: int, **changes: Any) -> TrainingParameters:
    """Of a training of the task, in units that are measured now."""
    problem = measured_problem(task, seed)
    of_mu = {"sigma": problem.mu_unit, "probe_noise": problem.mu_unit}
    own = {**SLOW, **SCHEDULE, **of_mu, **task.training}
    asked = {"problem": problem, "seed": seed, "learner": "regression", **own, **changes}
    return TrainingParameters.model_validate(asked)


def write(policy: LearnedPolicy, path: Path) -> Path:
    """The policy's file."""
    assert isinstance(policy, ActorPolicy)
    policy.file.write(path)
    return path
