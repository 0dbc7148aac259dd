"""Learning on a task: what is learned and in which units, measured from a few rides, and the training itself."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from cbf_clf_qp.estimates import Estimates, measure
from cbf_clf_qp.functions import Array
from rabbit_description.task import ControlTask, TaskError
from rabbit_description.task_simulation import TaskSimulation
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy
from rl_cbf_clf_controller.problem import LEAST, QUANTILE, ROOM, Problem
from rl_cbf_clf_controller.task_controller import NOMINAL, ORACLE, TaskController

from rl_trainer import session
from rl_trainer.parameters import TrainingParameters
from rl_trainer.rollout import Moment
from rl_trainer.task_episode import Ride, ride_of
from rl_trainer.training import Trainer
from rl_trainer.transitions import Doubt, Transition, TransitionBuilder

RIDES = 3  # of the nominal controller and of the oracle, each
SLOW = {"actor_rate": 6e-4, "critic_rate": 1e-3, "polyak": 3e-3, "batch": 160, "hidden1": 64, "hidden2": 64}
SCHEDULE = {"sigma_factors": (1,), "nominal_episodes": 1, "updates_per_tick": 0, "updates_least": 600, "episodes": 5}
SCHEDULE |= {"every_tick": True}  # mu is known at the limit of the input, too


def measured_problem(task: ControlTask, seed: int) -> Problem:
    """What is learned on a task, with the units of observations, estimates and errors.

    Rides of the nominal controller and of the oracle show them: an observation has its mean and deviation, an estimate
    `ROOM` times the greatest that the oracle has, an error the root of its mean square under the nominal model.
    Raises `TaskError` where one difference does not measure the quantities, or no ride has two ticks.
    """
    try:
        measure(task.tick.terms)
    except ValueError as error:
        raise TaskError(f"{task.name}: {error}") from error
    controller = TaskController(task)
    problem, greatest, errors, moments = controller.problem, list[tuple[Array, Array]](), list[Array](), list[Moment]()
    for i, name in enumerate((NOMINAL, ORACLE) * RIDES):
        ride = ride_of(controller, name, seed * 1000 + i)
        moments += ride.moments
        if name == NOMINAL:
            errors += [_error(transition, problem.has_clf) for transition in transitions_of(ride, problem)]
        else:
            greatest += [_greatest(m.estimates, problem.has_clf) for m in ride.moments if m.estimates]
    if not errors:
        raise TaskError(f"{task.name}: the nominal controller's rides end before anything is measured")
    read = [moment.output.observation for moment in moments]
    means, deviations = np.mean(read, axis=0).tolist(), _floored(np.std(read, axis=0))
    alphas, betas = zip(*greatest, strict=True)
    alpha_scale, beta_scale = (_floored(ROOM * np.quantile(sizes, QUANTILE, axis=0)) for sizes in (alphas, betas))
    return replace(
        problem,
        units=tuple(zip(problem.observation, means, deviations, strict=True)),
        alpha_scale=alpha_scale,
        beta_scale=beta_scale,
        error_scale=_floored(np.sqrt(np.mean(np.square(errors), axis=0))),
        mu_unit=max(float(np.std([moment.output.mu for moment in moments])), LEAST),
    )


def transitions_of(ride: Ride, problem: Problem) -> list[Transition]:
    """The transitions of a ride that were measured; the units of the problem need not be known yet."""
    ones = (1.0,) * len(problem.quantities)
    known = replace(problem, alpha_scale=ones, beta_scale=ones, error_scale=ones)
    builder = TransitionBuilder(TrainingParameters(problem=known))
    transitions = [builder.add(moment.state, moment.output) for moment in ride.moments]
    return [transition for transition in transitions if transition and not transition.doubt & Doubt.UNMEASURED]


def _greatest(estimates: Estimates, has_clf: bool) -> tuple[Array, Array]:
    """The greatest |alpha| and |beta| (n,) of the quantities; of V those of the outputs, which LgV multiplies."""
    sizes = np.abs(np.column_stack([estimates.alpha, estimates.beta]))
    if has_clf and estimates.output_error is not None:
        sizes[0] = np.abs(estimates.output_error).max(axis=0)
    return sizes[:, :-1].max(axis=1), sizes[:, -1]


def _error(transition: Transition, has_clf: bool) -> Array:
    """The error of each quantity; that of V over |LgV| + 1, as the reward has it."""
    error: Array = np.array(transition.error)
    if has_clf:
        error[0] /= np.linalg.norm(transition.LgV) + 1
    return error


def _floored(values: Array) -> tuple[float, ...]:
    return tuple(np.maximum(values, LEAST).tolist())


def train(
    task: ControlTask, seed: int, say: Callable[[str], object] = print, **changes: Any
) -> tuple[ActorPolicy, Problem]:
    """Ride with the present estimates and noise, learn from what was measured, repeat; the policy and what it learned.

    `changes`: of `TrainingParameters`. `say` hears how wrong the estimates were: the root of the mean square over an
    episode and the quantities, in units of `reward.error_unit`.
    """
    parameters = training_parameters(task, seed, **changes)
    trainer, controller = Trainer(parameters), TaskController(task, parameters.problem)

    def make_controller(policy: LearnedPolicy, sigma: float) -> TaskController:
        controller.policy, controller.sigma = policy, sigma
        return controller

    for report in session.train(trainer, TaskSimulation(task), make_controller):
        error = np.sqrt(-np.mean([report.reward[name] for name in parameters.problem.quantities]))
        say(f"seed {seed}, episode {report.episode + 1}: {report.kept} ticks, error {error:.2f}")
    return ActorPolicy(trainer.policy_file()), parameters.problem


def training_parameters(task: ControlTask, seed: int, **changes: Any) -> TrainingParameters:
    """The parameters of a training of the task, in units that are measured now."""
    problem = measured_problem(task, seed)
    of_mu = {"sigma": problem.mu_unit, "probe_noise": problem.mu_unit}
    usual = {"learner": "regression", **SLOW, **SCHEDULE, **of_mu}
    return TrainingParameters.model_validate({"problem": problem, "seed": seed, **usual, **task.training, **changes})
