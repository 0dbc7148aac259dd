"""The controller of one tick: state in, torque out. Read this file first.

    relabel to stance/swing -> nominal model -> outputs y, precontrol u(mu) -> quantities (V-dot, B-ddot, F) in mu
    -> policy's alpha, beta -> rows -> QP -> mu -> exploration -> torque, saturated

Nominal CLF-QP, CBF-CLF-QP and their learned versions are this one path with other rows and another policy.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from rabbit_description.gait_library import Gaits
from rabbit_description.state import SWAP_STATE, SWAP_TORQUE, TICK_SECONDS, Array, Leg, RobotState, StonePreview

from rl_cbf_clf_controller.adaptation import Measured, make_adaptation
from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.contact_force import force_rows, literal_cone_rows
from rl_cbf_clf_controller.context import ModelContext
from rl_cbf_clf_controller.ecbf import Barriers, ecbf_bound, ecbf_gains, stone_barriers
from rl_cbf_clf_controller.io_linearization import precontrol
from rl_cbf_clf_controller.l1_adaptation import l1_adaptation
from rl_cbf_clf_controller.nominal_model import Kinematics, NominalModel, PinnedDynamics
from rl_cbf_clf_controller.objective import Objective, make_objective
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.qp import Decision, QuadraticProgram, build_qp, unpack
from rl_cbf_clf_controller.quantities import QuantityModel
from rl_cbf_clf_controller.res_clf import ResClf
from rl_cbf_clf_controller.rows import Rows
from rl_cbf_clf_controller.saturation import clip, saturation_rows
from rl_cbf_clf_controller.solvers import Solution, make_solver
from rl_cbf_clf_controller.step_outputs import make_steps
from rl_cbf_clf_controller.uncertainty import NO_OUTPUT_ERROR, Estimates, Problem
from rl_cbf_clf_controller.virtual_constraints import Outputs
from rl_cbf_clf_controller.worst_case import worst_errors

NO_BARRIERS = np.full(2, np.nan)
NO_TORQUE = np.full(4, np.nan)
NOTHING = np.zeros(0)


class ControllerError(ValueError):
    """A state that the controller refuses: names the field, its value and what was expected."""


@dataclass(frozen=True)
class ControllerOutput:
    """All of one tick that a person debugging, a recorder or the trainer wants.

    `torque` (4,) N m, left/right order, saturated; `eta` (8,); `barriers`, `barrier_rates` (2,), NaN on flat ground;
    `mu` (4,) as executed after exploration and saturation, `mu_qp` the QP's, `omega` the noise; `mu_held` (4,) what the
    last tick's torque amounts to at this state, that is y-ddot by the nominal model, NaN where the step is new; nominal
    value of the quantities = `nominal_a` mu + `nominal_b`, (n, 4) and (n,); `alpha`, `beta` the estimates in all;
    `observation` (14,), on stones (15,), there with a gait library (16,); `LgV` (4,); `clf_slack`, `rescue_slack`: the
    paper's d, the sum of the slacks of last resort; `active` names the rows that hold with equality; `answered` is
    False where the guard solver had to answer; `fault` is empty, or why the episode must end; `objective`, `adaptation`
    name what was minimised and adapted; `identified` (17,) is the robot as in `adaptation.KNOWN`, `adapted` (5n + 20,)
    its part of the estimates, as in `Estimates.packed`; both (0,) without adaptation.
    """

    tick: int
    torque: Array
    stance: Leg
    step_index: int
    step_time: float
    phase: float
    eta: Array
    V: float
    barriers: Array
    barrier_rates: Array
    mu: Array
    mu_qp: Array
    omega: Array
    mu_held: Array
    quantities: tuple[str, ...]
    nominal_a: Array
    nominal_b: Array
    alpha: Array
    beta: Array
    observation: Array
    LgV: Array
    clf_slack: float
    rescue_slack: float
    active: tuple[str, ...]
    saturated: bool
    solver: str
    status: str
    answered: bool
    solve_seconds: float
    policy_version: str
    fault: str = ""
    objective: str = "paper"
    adaptation: str = "none"
    identified: Array = field(default_factory=lambda: NOTHING)
    adapted: Array = field(default_factory=lambda: NOTHING)


@dataclass(frozen=True)
class Terms:
    """The model terms of one tick, before any decision is taken."""

    q_s: Array
    dq_s: Array
    feet: Kinematics
    dynamics: PinnedDynamics
    outputs: Outputs
    eta: Array
    output_dynamics: Affine
    precontrol: Affine
    model: QuantityModel
    nominal: Affine
    context: ModelContext

    @property
    def barriers(self) -> Barriers | None:
        return self.model.barriers

    @property
    def force(self) -> Affine:
        """(F_N, F_T), N, by the nominal model, affine in the torque."""
        return self.dynamics.normal_tangential


class Constraint(Protocol):
    """A constraint of one's own: rows from the terms of a tick (its q_s, feet, nominal model, precontrol)."""

    def rows(self, terms: Terms) -> Rows: ...


@dataclass
class StepState:
    """Which leg stands, for how long, how many steps have been taken; the last tick's torque, stance/swing order."""

    stance: Leg = Leg.LEFT
    index: int = 0
    start_tick: int = 0
    has_begun: bool = False
    torque: Array = field(default_factory=lambda: NO_TORQUE)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))


class Controller:
    """One controller with its parameters, gait and policy; `step` is called once a tick.

    `constraints` are added to the QP; `urdf` replaces RABBIT's as the nominal model (the same joints and feet).
    """

    def __init__(
        self,
        parameters: ControllerParameters,
        gait: Gaits,
        policy: Policy,
        constraints: Sequence[Constraint] = (),
        urdf: str | None = None,
    ) -> None:
        self.parameters = parameters
        self.policy = policy
        self._extra = tuple(constraints)
        self.clf = ResClf(4, parameters.eps, (parameters.kp, parameters.kd))
        self._K_b = ecbf_gains((parameters.barrier_pole_1, parameters.barrier_pole_2))
        self._steps = make_steps(gait, parameters.stone_aim)
        self._model = NominalModel(urdf)
        self._solver = make_solver(parameters.qp_solver)
        self._l1 = l1_adaptation(parameters, self.clf)
        self._adaptation = make_adaptation(parameters.adaptation, urdf)
        self.reset(0)

    @property
    def unanswered(self) -> int:
        """Ticks since construction that the chosen solver did not answer itself."""
        return self._solver.unanswered

    def reset(self, seed: int) -> None:
        """Begin an episode: left leg stands; the exploration noise starts from `seed`."""
        self._step = StepState(rng=np.random.default_rng(seed))
        self._constraints = self._steps.first()
        self._solver.reset()
        if self._l1:
            self._l1.reset()
        self._adaptation.reset()

    def step(self, state: RobotState) -> ControllerOutput:
        """The torque for one tick.

        Raises:
            ControllerError: a state of the wrong shape, not finite, or without the preview of the next stone; a policy
                that does not tell the output error where the objective or the adaptation needs it.
        """
        self._check(state)
        if np.isfinite(state.applied).all():  # in real time it may be another than the one that this gave last
            self._step.torque = state.applied[SWAP_TORQUE] if self._step.stance is Leg.RIGHT else state.applied
        state = self._adaptation.corrected(state)
        fault = self._swap_legs(state)
        if not self._step.has_begun:
            self._begin_step(state)
        terms = self.terms(state)
        policy = self.policy.estimate(terms.context)
        adapted = self._adapted(state, terms, policy)
        estimates = policy + adapted if adapted else policy
        control = self._control(terms, estimates)
        rows = [*self.rows(terms, estimates, control), *(own.rows(terms) for own in self._extra)]
        qp = build_qp(rows, self.objective(terms, estimates))
        solution = self._solver.solve(qp)
        decision = unpack(qp, solution.x)
        if not solution.solved:
            fault = fault or f"no solver answered: {solution.status}"
            decision = Decision(np.zeros(4), decision.slack, decision.active)
        return self._output(state, terms, estimates, adapted, control, qp, solution, decision, fault)

    def terms(self, state: RobotState) -> Terms:
        """Nominal terms at a state, with the present stance leg."""
        q_s, dq_s = self._relabel(state.q), self._relabel(state.dq)
        feet = self._model.update(q_s, dq_s)
        dynamics = self._model.pinned()
        outputs = self._constraints.evaluate(q_s, dq_s)
        eta = outputs.eta
        output_dynamics = outputs.second_derivative(dynamics.acceleration)
        control = precontrol(output_dynamics)
        p = self.parameters
        barriers = self._barriers(feet, state.preview)
        clf = self.clf.derivative(eta)
        model = QuantityModel(outputs, clf, barriers, outputs_only=p.problem is Problem.IO_RL_CLF_QP)
        nominal = model.evaluate(dynamics).after(control)
        z = (*feet.hip, outputs.phase, *feet.hip_rate, outputs.phase_rate)
        stone = (state.preview.l_min, *self._steps.wanted) if p.on_stones and state.preview else ()
        observation = np.concatenate([eta, z, stone])
        context = ModelContext(observation, clf.a[0], q_s, dq_s, model, dynamics, nominal, control)
        return Terms(q_s, dq_s, feet, dynamics, outputs, eta, output_dynamics, control, model, nominal, context)

    def rows(self, terms: Terms, estimates: Estimates, control: Affine) -> list[Rows]:
        """Which QP has which rows: every constraint of this tick, with its estimates."""
        p = self.parameters
        saturation = saturation_rows(control, p.torque_limit)
        flat_forces = [self._force_rows(terms.force.after(control))] if p.flat_force_rows and not p.on_stones else []
        if terms.model.outputs_only:
            return [self._clf_rows(terms.eta, terms.model.clf_derivative), *flat_forces, saturation]
        learned = terms.nominal + Affine(estimates.alpha, estimates.beta)
        cases = [learned + error for error in worst_errors(p, terms.context)] or [learned]
        return [*(rows for case in cases for rows in self._case_rows(terms, case)), *flat_forces, saturation]

    def _case_rows(self, terms: Terms, values: Affine) -> list[Rows]:
        """The rows on the quantities, if `values` they have."""
        p = self.parameters
        rows = [self._clf_rows(terms.eta, Affine(values.a[:1], values.b[:1]))]
        if terms.barriers is not None and p.barrier_rows:
            lower = ecbf_bound(terms.barriers, self._K_b) - values.b[1:3]
            rows.append(Rows.at_least(("B1", "B2"), values.a[1:3], lower, p.barrier_rescue_weight).normalised())
        if terms.barriers is not None and p.force_rows:
            rows.append(self._force_rows(Affine(values.a[3:], values.b[3:])))
        return rows

    def _force_rows(self, force: Affine) -> Rows:
        """C1 and the cone for `force` = (F_N, F_T), affine in mu."""
        p = self.parameters
        build = force_rows if p.cone == "two_rows" else literal_cone_rows
        cone = p.friction_coeff - p.friction_margin
        return build(force, p.min_normal_force, cone, p.force_rescue_weight).normalised()

    def _adapted(self, state: RobotState, terms: Terms, policy: Estimates) -> Estimates | None:
        """What is added to the policy's estimates, if anything; with L1 they are an input, as in the first approach."""
        if self._l1 is None:
            self._check_estimates(terms, policy)
            force = state.foot_force[[self._step.stance, self._step.stance.other]]
            return self._adaptation.estimate(terms.context, Measured(state.tick, self._step.torque, force))
        whole = Affine(np.eye(4) + policy.alpha, policy.beta)
        belief = whole.inverse().after(terms.output_dynamics)
        compensation = self._l1.compensation(terms.eta, belief, self._step.torque)
        return Estimates(np.zeros((4, 4)), whole(compensation) - policy.beta)

    def _check_estimates(self, terms: Terms, policy: Estimates) -> None:
        p = self.parameters
        if self.policy.adaptation not in (None, p.adaptation):
            raise ControllerError(
                f"policy {self.policy.version} adds to adaptation {self.policy.adaptation}: expected {p.adaptation}"
            )
        if policy.output_error or terms.model.outputs_only or (p.objective, p.adaptation) == ("paper", "none"):
            return
        needs = f"objective {p.objective} and adaptation {p.adaptation}"
        raise ControllerError(f"policy {self.policy.version} tells no output error: {needs} expect a structured policy")

    def objective(self, terms: Terms, estimates: Estimates) -> Objective | None:
        """What this tick's QP minimises; in the first approach y'' = mu, as its input makes it."""
        error = NO_OUTPUT_ERROR if terms.model.outputs_only else estimates.output_error
        return make_objective(self.parameters, terms.outputs, error)

    def _barriers(self, feet: Kinematics, stone: StonePreview | None) -> Barriers | None:
        p = self.parameters
        if stone is None or not p.on_stones:
            return None
        inside = StonePreview(stone.index, stone.l_min + p.stone_margin, stone.l_max - p.stone_margin)
        return stone_barriers(feet, inside, p.R1, p.R2)

    def _clf_rows(self, eta: Array, derivative: Affine) -> Rows:
        p = self.parameters
        upper = np.array([self.clf.bound(eta)]) - derivative.b
        weight = p.slack_weight if p.on_stones else p.clf_rescue_weight
        rows = Rows.at_most(("CLF",), derivative.a, upper, weight, rescue=not p.on_stones)
        return rows if p.on_stones and p.clf_row == "literal" else rows.normalised()

    def _control(self, terms: Terms, estimates: Estimates) -> Affine:
        """The torque affine in mu; in the first approach with the policy's own input [approach1_input]."""
        if not terms.model.outputs_only:
            return terms.precontrol
        return terms.precontrol.after(Affine(np.eye(4) + estimates.alpha, estimates.beta))

    def _output(
        self,
        state: RobotState,
        terms: Terms,
        estimates: Estimates,
        adapted: Estimates | None,
        control: Affine,
        qp: QuadraticProgram,
        solution: Solution,
        decision: Decision,
        fault: str,
    ) -> ControllerOutput:
        p, step, barriers = self.parameters, self._step, terms.barriers
        omega = p.sigma * step.rng.standard_normal(4) if p.sigma > 0 else np.zeros(4)
        mu = decision.mu + omega
        wanted = control(mu)
        torque = clip(wanted, p.torque_limit)
        saturated = bool((torque != wanted).any())
        if saturated:
            mu = np.linalg.solve(control.a, torque - control.b)
        mu_held, step.torque = terms.output_dynamics(step.torque), torque
        return ControllerOutput(
            tick=state.tick,
            torque=torque[SWAP_TORQUE] if step.stance is Leg.RIGHT else torque,
            stance=step.stance,
            step_index=step.index,
            step_time=(state.tick - step.start_tick) * TICK_SECONDS,
            phase=terms.outputs.phase,
            eta=terms.eta,
            V=self.clf.value(terms.eta),
            barriers=NO_BARRIERS if barriers is None else barriers.B,
            barrier_rates=NO_BARRIERS if barriers is None else barriers.dB,
            mu=mu,
            mu_qp=decision.mu,
            omega=omega,
            mu_held=mu_held,
            quantities=p.problem.quantities,
            nominal_a=terms.nominal.a,
            nominal_b=terms.nominal.b,
            alpha=estimates.alpha,
            beta=estimates.beta,
            observation=terms.context.observation,
            LgV=terms.context.LgV,
            clf_slack=float(decision.slack[~qp.rescue].sum()),
            rescue_slack=float(decision.slack[qp.rescue].sum()),
            active=tuple(name for name, on in zip(qp.names, decision.active, strict=True) if on),
            saturated=saturated,
            solver=solution.solver,
            status=solution.status,
            answered=solution.solver == p.qp_solver,
            solve_seconds=solution.seconds,
            policy_version=self.policy.version,
            objective=p.objective,
            adaptation=p.adaptation,
            identified=self._adaptation.known,
            adapted=adapted.packed if adapted and not terms.model.outputs_only else NOTHING,
            fault=fault,
        )

    def _relabel(self, values: Array) -> Array:
        return values[SWAP_STATE] if self._step.stance is Leg.RIGHT else values

    def _swap_legs(self, state: RobotState) -> str:
        """Swap stance and swing at a touchdown; a fault where this and the simulator's count disagree."""
        p, step = self.parameters, self._step
        swing = step.stance.other
        if state.contact[swing] and (state.tick - step.start_tick) * TICK_SECONDS > p.swap_time:
            phase = self._constraints.evaluate(self._relabel(state.q), self._relabel(state.dq)).phase
            if phase > p.swap_phase:
                step.stance, step.index, step.start_tick = swing, step.index + 1, state.tick
                step.torque, step.has_begun = NO_TORQUE, False
        if state.touchdowns != step.index:
            return f"contact disagreement: {state.touchdowns} touchdowns, {step.index} steps"
        return ""

    def _begin_step(self, state: RobotState) -> None:
        """The step's outputs, from where the feet stand and the stone that is seen."""
        q_s, dq_s = self._relabel(state.q), self._relabel(state.dq)
        taken = -float(self._model.update(q_s, dq_s).swing[0])
        self._constraints = self._steps.begin(q_s, dq_s, taken, state.preview)
        self._step.has_begun = True

    def _check(self, state: RobotState) -> None:
        for name, value in (("q", state.q), ("dq", state.dq)):
            if value.shape != (7,) or not np.isfinite(value).all():
                raise ControllerError(f"state.{name} = {value}: expected 7 finite values")
        preview = state.preview
        if not self.parameters.on_stones:
            return
        if preview is None or preview.index != state.touchdowns + 1:
            raise ControllerError(f"state.preview = {preview}: expected stone {state.touchdowns + 1}")
        if not 0 < preview.l_min < preview.l_max < 2:
            raise ControllerError(f"state.preview = {preview}: expected 0 < l_min < l_max < 2 m")
