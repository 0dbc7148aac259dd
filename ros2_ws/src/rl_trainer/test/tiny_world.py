"""Ticks, transitions and a tiny world for the learners, without a robot: the truth is written down, not simulated."""

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.constraints import ResClf
from rabbit_description.state import TICK_SECONDS, Array, Leg, RobotState
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.policy import LearnedPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP, RL_CLF_QP
from rl_trainer.transitions import Doubt, Transition

_CLF = ResClf(4, 0.1, (0.5, 0.8660254037844386))
F, G, P = (ca.DM(matrix).full() for matrix in (_CLF.F, _CLF.G, _CLF.P))


def V_dot(eta: Array) -> Affine:
    """V-dot, affine in y'' (4,)."""
    return Affine(2 * (eta @ P @ G)[None], np.array([eta @ (F.T @ P + P @ F) @ eta]))


def make_state(tick: int, **changes: Any) -> RobotState:
    """The left leg stands with 300 N upright."""
    state = RobotState(
        tick=tick,
        q=np.array([0, 0.78, 0, 0, 0, 0, 0], dtype=float),
        dq=np.zeros(7),
        foot_force=np.array([[30.0, 300.0], [0.0, 0.0]]),
        contact=np.array([True, False]),
        touchdowns=0,
        preview=None,
    )
    return replace(state, **changes)


def make_output(tick: int, problem: Problem = RL_CBF_CLF_QP, **changes: Any) -> ControllerOutput:
    """Nothing moves, nothing is corrected."""
    n, zeros = len(problem.quantities), np.zeros(4)
    output = ControllerOutput(
        tick=tick,
        **dict.fromkeys(("torque", "mu", "mu_qp", "omega", "LgV"), zeros),
        **{"clf_slack": 0.0, "rescue_slack": 0.0, "solve_seconds": 0.0, "V": 0.0},
        **{"active": (), "saturated": False, "solver": "none", "status": "", "answered": True},
        stance=Leg.LEFT,
        step_index=0,
        step_time=tick * TICK_SECONDS,
        phase=0.3,
        eta=np.zeros(8),
        barriers=np.zeros(2),
        barrier_rates=np.zeros(2),
        barrier_names=("B1", "B2"),
        mu_held=np.full(4, np.nan),
        quantities=problem.quantities,
        nominal_a=np.zeros((n, 4)),
        nominal_b=np.zeros(n),
        measured=np.zeros(n),
        alpha=np.zeros((n, 4)),
        beta=np.zeros(n),
        observation=np.zeros(len(problem.observation)),
        policy_version="zero",
    )
    return replace(output, **changes)


def drift(observation: Array) -> Array:
    """Delta_1 of the tiny world, a smooth function of phase and pitch-like coordinates, rad/s^2."""
    return 60 * np.sin(np.arange(4) + observation[..., 10:11]) + 20 * observation[..., 0:4]


def true_errors(problem: Problem, observation: Array, LgV: Array) -> tuple[Array, Array]:
    """Closed-form alpha (n, 4) and beta (n,) of a plant of twice the mass: Delta_2 = -I/2."""
    if problem.corrects_input:  # y'' = v + Delta_1 - v/2, so v = 2 y'' - 2 Delta_1
        return np.eye(4), -2 * drift(observation)
    alpha, beta = [-LgV / 2], [LgV @ drift(observation)]
    if problem == RL_CBF_CLF_QP:
        alpha += [np.full(4, -0.2), np.full(4, 0.1), np.zeros(4), np.zeros(4)]
        beta += [10 * observation[8], -10 * observation[10], 300.0, 100 * observation[8]]
    return np.array(alpha), np.array(beta)


def random_transition(problem: Problem, rng: np.random.Generator, **changes: Any) -> Transition:
    """At a random state of the tiny world, measured without error."""
    center, scale = np.array([problem.unit(name) for name in problem.observation]).T
    observation = center + scale * rng.standard_normal(len(center))
    LgV = V_dot(observation[:8]).a[0]
    mu_qp = 30 * rng.standard_normal(4)
    mu = mu_qp + 8 * rng.standard_normal(4)
    n = len(problem.quantities)
    used_alpha, used_beta = np.zeros((n, 4)), np.zeros(n)
    alpha, beta = true_errors(problem, observation, LgV)
    nominal = np.arange(n, dtype=float)
    measured = nominal + alpha @ mu + beta
    if problem.corrects_input:
        used_alpha, used_beta = 0.5 * rng.standard_normal((4, 4)), 20 * rng.standard_normal(4)
        nominal = mu + used_alpha @ mu + used_beta
        measured = nominal / 2 + drift(observation)
    transition = Transition(
        problem=problem,
        tick=0,
        step_index=1,
        observation=observation,
        LgV=LgV,
        mu=mu,
        mu_qp=mu_qp,
        alpha=used_alpha,
        beta=used_beta,
        nominal=nominal,
        measured=measured,
        next_observation=observation,
        next_LgV=LgV,
        next_mu=mu,
        failed=False,
        doubt=Doubt.NONE,
    )
    return replace(transition, **changes)


class ToyWorld:
    """Four double integrators of twice the expected mass, for a fixed number of ticks; y is in `q[3:]`."""

    def __init__(self, ticks: int = 40) -> None:
        self.ticks = ticks

    def reset(self, seed: int) -> RobotState:
        self._rng = np.random.default_rng(seed)
        self._y, self._dy, self._tick = 0.1 * self._rng.standard_normal(4), np.zeros(4), 0
        self._applied = np.full(4, np.nan)
        return self._state()

    def step(self, torque: Array) -> RobotState:
        acceleration = torque / 2 + 5 * np.sin(self._y)
        self._y = self._y + TICK_SECONDS * self._dy + TICK_SECONDS**2 / 2 * acceleration
        self._dy = self._dy + TICK_SECONDS * acceleration
        self._tick += 1
        self._applied = torque
        return self._state()

    def _state(self) -> RobotState:
        q, dq = np.array([0, 0.78, 0, *self._y]), np.array([0, 0, 0, *self._dy])
        return make_state(self._tick, q=q, dq=dq, running=self._tick < self.ticks, applied=self._applied)


@dataclass
class ToyController:
    """PD on the tiny world, in the clothes of the RL-CLF-QP."""

    policy: LearnedPolicy
    sigma: float

    def reset(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._last: Array | None = None

    def step(self, state: RobotState) -> ControllerOutput:
        eta = np.concatenate([state.q[3:], state.dq[3:]])
        LgV = V_dot(eta).a[0]
        observation = np.concatenate([eta, np.zeros(6)])
        estimates = self.policy.act(observation, LgV)
        mu = -20 * eta[:4] - 8 * eta[4:] + self.sigma * self._rng.standard_normal(4)
        changes = {"eta": eta, "V": eta @ P @ eta, "LgV": LgV, "mu": mu, "torque": mu, "observation": observation}
        nominal = V_dot(eta)
        measured = np.full(1, np.nan)
        if self._last is not None:
            measured = V_dot(self._last)((eta[4:] - self._last[4:]) / TICK_SECONDS)
        self._last = eta
        return make_output(
            state.tick,
            RL_CLF_QP,
            nominal_a=nominal.a,
            nominal_b=nominal.b,
            measured=measured,
            alpha=estimates.alpha,
            beta=estimates.beta,
            policy_version=self.policy.version,
            mu_held=state.applied,
            **changes,
        )


def tick(number: int, state: Any = None, output: Any = None) -> tuple[RobotState, ControllerOutput]:
    """By its number: `tick(3, state={...}, output={...})`."""
    return make_state(number, **(state or {})), make_output(number, **(output or {}))
