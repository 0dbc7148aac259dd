"""The controller of one tick: state in, torque out. Read `cbf_clf_qp.tick` first, then this, then `recipes.py`.

    relabel to stance/swing -> scene, nominal dynamics -> terms
    -> the tick of `cbf_clf_qp`: estimates, rows, QP -> mu -> exploration -> torque, saturated

Which leg stands, exploration and what is kept from tick to tick are here; what a controller constrains is its recipe.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from cbf_clf_qp.solvers import make_solver
from cbf_clf_qp.tick import Constraint, Decided, Quantity, Terms, decide, measured
from cbf_clf_qp.tracing import Traced
from rabbit_description.gait import Gaits
from rabbit_description.state import SWAP_STATE, SWAP_TORQUE, TICK_SECONDS, Array, Leg, RobotState, StonePreview

from rl_cbf_clf_controller.controller_output import NOTHING, ControllerOutput
from rl_cbf_clf_controller.generated_model import arithmetic, make_model
from rl_cbf_clf_controller.identified_robot import IdentifiedRobot
from rl_cbf_clf_controller.kinds import find_kind
from rl_cbf_clf_controller.nominal_terms import NominalTerms
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.recipes import make_clf, make_recipe
from rl_cbf_clf_controller.scene import ControllerError, Scene, is_finite
from rl_cbf_clf_controller.step_outputs import Touchdown, make_steps

NO_BARRIERS = np.full(2, np.nan)
ROUNDING = 1e-6  # N m, by which the QP may be over the limit
NO_TORQUE = np.full(4, np.nan)
NO_NOISE = np.zeros(4)


@dataclass
class StepState:
    """Which leg stands, for how long, how many steps have been taken, how long the last one took, s; the last tick's
    torque and scene of this step."""

    stance: Leg = Leg.LEFT
    index: int = 0
    start_tick: int = 0
    seconds_before: float | None = None
    has_begun: bool = False
    torque: Array = field(default_factory=lambda: NO_TORQUE)
    last: Scene | None = None
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))


class Controller:
    """One controller with its parameters, gait and policy; `step` is called once a tick.

    `constraints` are added to the QP; `urdf` replaces RABBIT's as the nominal model (the same joints and feet).
    After a tick, `terms` and `decided` have all of it.
    """

    terms: Terms[Scene]
    decided: Decided

    def __init__(
        self,
        parameters: ControllerParameters,
        gait: Gaits,
        policy: Policy,
        constraints: Sequence[Constraint] = (),
        urdf: str | None = None,
    ) -> None:
        self.parameters = parameters
        self.clf = make_clf(parameters)
        self._robot = IdentifiedRobot(urdf) if parameters.adaptation == "identification" else None
        estimators = (policy, self._robot) if self._robot else (policy,)
        self.recipe = make_recipe(parameters, estimators, constraints)
        self.policy = policy
        self._terrain = find_kind(parameters.controller).terrain(parameters)
        self._model = make_model(urdf)
        self._start, self.steps = gait.x_start, make_steps(gait, parameters, self._model)
        self._solver = make_solver(parameters.qp_solver)
        self._terms = NominalTerms(parameters, self.recipe.quantities)
        self._measure = traced_measurement(self.recipe.quantities).twin()
        self.reset(0)

    @property
    def policy(self) -> Policy:
        """The first of the recipe's estimators; another one may be set between two ticks.

        Raises:
            ControllerError: it was trained beside another adaptation.
        """
        return self._policy

    @policy.setter
    def policy(self, policy: Policy) -> None:
        own, runs = policy.adaptation, self.parameters.adaptation
        if own not in (None, runs):
            raise ControllerError(f"policy {policy.version} adds to adaptation {own}: expected {runs}")
        self._policy = policy
        self.recipe = replace(self.recipe, estimators=(policy, *self.recipe.estimators[1:]))

    @property
    def unanswered(self) -> int:
        """Ticks since construction that the chosen solver did not answer itself."""
        return self._solver.unanswered

    @property
    def model_terms(self) -> str:
        """What computes them, see `generated_model.arithmetic`."""
        return arithmetic(self._model)

    def reset(self, seed: int) -> None:
        """Begin an episode: left leg stands; the exploration noise starts from `seed`."""
        self._step = StepState(rng=np.random.default_rng(seed))
        self._constraints = self.steps.first()
        self._solver.reset()
        for estimator in self.recipe.estimators:
            estimator.reset()

    def rehearse(self) -> None:
        """Compute two ticks that nobody walks, so that the first one that counts finds its functions traced.

        For a controller that walks in real time. An episode begins with `reset`.
        """
        stone = StonePreview(1, 0.3, 0.4) if self.parameters.terrain == "stones" else None
        for tick in range(2):
            state = RobotState(tick, *self._start, np.zeros((2, 2)), np.zeros(2, dtype=bool), 0, stone)
            self.step(state).measured  # noqa: B018  what is computed when it is read is traced then
        self.reset(0)

    def step(self, state: RobotState) -> ControllerOutput:
        """The torque for one tick.

        Raises:
            ControllerError: a state of the wrong shape, not finite, or without the preview of the next stone; a policy
                that gives no output error where the objective needs it.
        """
        self._check(state)
        if is_finite(state.applied):  # in real time it may be another than the one that this gave last
            self._step.torque = state.applied[SWAP_TORQUE] if self._step.stance is Leg.RIGHT else state.applied
        if self._robot:
            state = self._robot.corrected(state)
        fault = self._swap_legs(state)
        if not self._step.has_begun:
            self._begin_step(state)
        self.terms = self.look(state)
        self.decided = self.decide(self.terms)
        output = self._output(state, fault)
        self._step.last = self.terms.scene
        return output

    def decide(self, terms: Terms[Scene]) -> Decided:
        """mu at a tick's terms, and all that it follows from."""
        return decide(self.recipe, terms, self._solver)

    def look(self, state: RobotState) -> Terms[Scene]:
        """The nominal terms at a state, with the present stance leg."""
        q_s, dq_s = self._relabel(state.q), self._relabel(state.dq)
        stance = self._step.stance
        if self._robot and self.parameters.prediction:
            q_s, dq_s = self._robot.predicted(q_s, dq_s, self._step.torque)
        return self._terms(
            q_s,
            dq_s,
            self._model.robot_at(q_s, dq_s),
            self._constraints.path_at(q_s, dq_s),
            state.foot_force if stance is Leg.LEFT else state.foot_force[::-1],
            state.tick,
            self._step.torque,
            int(stance),  # a number: a trace would hold for one leg only
            state.preview,
            self.steps.wanted,
        )

    def _output(self, state: RobotState, fault: str) -> ControllerOutput:
        p, step, decided = self.parameters, self._step, self.decided
        mu_qp, omega = decided.mu, NO_NOISE
        if not decided.solution.solved:
            fault, mu_qp = fault or f"no solver answered: {decided.solution.status}", np.zeros(4)
        mu, wanted = mu_qp, decided.u
        if p.sigma > 0:
            omega = p.sigma * step.rng.standard_normal(4)
            mu = mu_qp + omega
        if mu is not decided.mu:
            wanted = decided.control(mu)
        torque, largest = wanted, max(map(abs, wanted.tolist()))
        if not largest <= p.torque_limit:
            torque = np.minimum(np.maximum(wanted, -p.torque_limit), p.torque_limit)
        saturated = largest > p.torque_limit + ROUNDING
        if saturated:
            mu = np.linalg.solve(decided.control.a, torque - decided.control.b)
        step.torque = torque
        return ControllerOutput.deferring(
            Details(self, self.terms, decided, step.last, self._robot.values if self._robot else None),
            tick=state.tick,
            torque=torque[SWAP_TORQUE] if step.stance is Leg.RIGHT else torque,
            stance=step.stance,
            step_index=step.index,
            step_time=(state.tick - step.start_tick) * TICK_SECONDS,
            mu=mu,
            mu_qp=mu_qp,
            omega=omega,
            saturated=saturated,
            policy_version=self.policy.version,
            objective=p.objective,
            adaptation=p.adaptation,
            fault=fault,
        )

    def measured(self, last: Scene | None, now: Scene) -> Array:
        """The quantities (n,) over the last tick, NaN where this or the step began with it."""
        if last is None or last.tick != now.tick - 1:
            return np.full(len(self.recipe.names), np.nan)
        measured: Array = self._measure(last, now, TICK_SECONDS)[0]
        return measured

    def _relabel(self, values: Array) -> Array:
        return values[SWAP_STATE] if self._step.stance is Leg.RIGHT else values

    def _swap_legs(self, state: RobotState) -> str:
        """Swap stance and swing at a touchdown; a fault where this and the simulator's count disagree."""
        p, step = self.parameters, self._step
        swing = step.stance.other
        if state.contact[swing] and (state.tick - step.start_tick) * TICK_SECONDS > p.swap_time:
            phase = self._constraints.evaluate(self._relabel(state.q), self._relabel(state.dq)).phase
            if phase > p.swap_phase:
                step.seconds_before = (state.tick - step.start_tick) * TICK_SECONDS
                step.stance, step.index, step.start_tick = swing, step.index + 1, state.tick
                step.torque, step.last, step.has_begun = NO_TORQUE, None, False
        if state.touchdowns != step.index:
            return f"contact disagreement: {state.touchdowns} touchdowns, {step.index} steps"
        return ""

    def _begin_step(self, state: RobotState) -> None:
        """The step's outputs, from where the feet stand and the stone that is seen."""
        q_s, dq_s = self._relabel(state.q), self._relabel(state.dq)
        taken = -float(self._model.update(q_s, dq_s).swing[0])
        touchdown = Touchdown(q_s, dq_s, taken, self._step.seconds_before, state.preview)
        self._constraints = self.steps.begin(touchdown)
        self._step.has_begun = True

    def _check(self, state: RobotState) -> None:
        q, dq = state.q, state.dq
        if not (q.shape == dq.shape == (7,) and is_finite(q) and is_finite(dq)):
            wrong = "dq" if q.shape == (7,) and is_finite(q) else "q"
            raise ControllerError(f"state.{wrong} = {getattr(state, wrong)}: expected 7 finite values")
        self._terrain.check(state)


@dataclass(slots=True)
class Details:
    """What of a `ControllerOutput` does not decide the torque: computed when it is read, the torque is out by then.

    `last`: the scene of the tick before in this step; `found`: what is identified of the robot, and of its angles.
    """

    controller: Controller
    terms: Terms[Scene]
    decided: Decided
    last: Scene | None
    found: tuple[Array, Array] | None

    phase = property(lambda self: self.terms.scene.outputs.phase)
    eta = property(lambda self: self.terms.scene.outputs.eta)
    observation = property(lambda self: self.terms.scene.observation)
    LgV = property(lambda self: self.terms.scene.LgV)
    V = property(lambda self: self.controller.clf.value(self.eta))
    barriers = property(lambda self: self._of_barriers("B"))
    barrier_rates = property(lambda self: self._of_barriers("dB"))
    quantities = property(lambda self: self.controller.recipe.names)
    nominal_a = property(lambda self: self.terms.nominal.a)
    nominal_b = property(lambda self: self.terms.nominal.b)
    measured = property(lambda self: self.controller.measured(self.last, self.terms.scene))
    alpha = property(lambda self: self.decided.estimates.alpha)
    beta = property(lambda self: self.decided.estimates.beta)
    clf_slack = property(lambda self: float(self.decided.slack_sums[0]))
    rescue_slack = property(lambda self: float(self.decided.slack_sums[1]))
    active = property(lambda self: self.decided.active)
    solver = property(lambda self: self.decided.solution.solver)
    status = property(lambda self: self.decided.solution.status)
    solve_seconds = property(lambda self: self.decided.solution.seconds)
    answered = property(lambda self: self.solver == self.controller.parameters.qp_solver)
    identified = property(lambda self: np.concatenate(self.found) if self.found else NOTHING)
    adapted = property(lambda self: self.decided.parts[1].packed if self.found else NOTHING)

    @property
    def mu_held(self) -> Array:
        """What the last tick's torque amounts to."""
        outputs, torque = self.terms.scene.outputs, self.terms.scene.torque
        return outputs.second_derivative(self.terms.dynamics.acceleration)(torque)

    def _of_barriers(self, name: str) -> Array:
        barriers = self.terms.scene.barriers
        return NO_BARRIERS if barriers is None else getattr(barriers, name)


@lru_cache(maxsize=64)
def traced_measurement(quantities: tuple[Quantity[Scene], ...]) -> Traced:
    """All quantities over the seconds between two scenes."""
    return Traced(lambda before, after, seconds: [measured(quantities, before, after, seconds)], quantities)
