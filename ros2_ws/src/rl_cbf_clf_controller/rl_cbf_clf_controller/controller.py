"""The controller of one tick: state in, torque out. Read `cbf_clf_qp.tick` first, then this, then `recipes.py`.

    relabel to stance/swing -> scene, nominal dynamics -> terms
    -> the tick of `cbf_clf_qp`: estimates, rows, QP -> mu -> exploration -> torque, saturated (`act`) -> `output`

Which leg stands, exploration and what is kept from tick to tick are here; what a controller constrains is its recipe.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates, model_error
from cbf_clf_qp.functions import one_at_a_time, places_of
from cbf_clf_qp.quantity import Constrained
from rabbit_description.gait import Gaits
from rabbit_description.state import (
    DOF,
    JOINTS,
    SWAP_STATE,
    SWAP_TORQUE,
    TICK_SECONDS,
    Array,
    Leg,
    RobotState,
    StonePreview,
    no_torque,
)

from rl_cbf_clf_controller.controller_output import NOTHING, Acted, ControllerOutput, flat, seen_fields
from rl_cbf_clf_controller.identified_robot import IdentifiedRobots
from rl_cbf_clf_controller.kinds import find_kind
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.recipes import barriers_of, make_tick
from rl_cbf_clf_controller.robot_numbers import Feet, read_robot
from rl_cbf_clf_controller.scene import ControllerError, Scene, is_finite
from rl_cbf_clf_controller.step_outputs import Touchdown, make_steps
from rl_cbf_clf_controller.terrain import Terrain
from rl_cbf_clf_controller.tick_functions import tick_functions
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints
from rl_cbf_clf_controller.walking import GAINS, Walking

ROUNDING = 1e-6  # N m, by which the QP may be over the limit
NO_TORQUE = no_torque()
SWAP_X = np.concatenate([SWAP_STATE, DOF + SWAP_STATE])
NO_NOISE = np.zeros(JOINTS)
CARRIED = 20.0  # N; a foot that presses less may be falling
DYNAMIC = ("sigma", "swap_time", "swap_phase", *GAINS)  # parameters that may change between two ticks

Further = Callable[[Walking], Sequence[Constrained]]  # quantities of RABBIT's symbols


def nothing_further(walking: Walking) -> Sequence[Constrained]:
    """The controller's own quantities are all."""
    return ()


@dataclass
class StepState:
    """Which leg stands, for how long, how many steps have been taken, how long the last one took, s; the last tick's
    torque and scene of this step. `place` (2,), m: where the stance foot came down, in the world; `moved` (2,), m: from
    there while it carried nothing; `carries`: whether it carries the robot."""

    stance: Leg = Leg.LEFT
    index: int = 0
    start_tick: int = 0
    seconds_before: float | None = None
    has_begun: bool = False
    torque: Array = field(default_factory=lambda: NO_TORQUE)
    last: Scene | None = None
    place: Array = field(default_factory=lambda: np.zeros(2))
    moved: Array = field(default_factory=lambda: np.zeros(2))
    carries: bool = True
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))


class Controller:
    """One controller with its parameters, gait and policy; `step` is called once a tick.

    `further`: quantities of your own, made of RABBIT's symbols, with rows in the QP and without estimates. `urdf`
    replaces RABBIT's as the nominal model (the same joints and feet). After a tick, `scene`, `parts` and `estimates`
    (each estimator's and their sum) and `decided` have all of it. One object serves one thread.
    """

    scene: Scene
    decided: Decided
    estimates: Estimates
    parts: list[Estimates]

    @one_at_a_time
    def __init__(
        self,
        parameters: ControllerParameters,
        gait: Gaits,
        policy: Policy,
        further: Further = nothing_further,
        urdf: str | None = None,
    ) -> None:
        self._kind = find_kind(parameters.controller)
        self._corrects_input = self._kind.problem.corrects_input
        walking, robot = Walking(), read_robot(urdf)
        added = further(walking)
        self.qp = make_tick(walking, parameters, added)
        self.barrier_names = tuple(barriers_of([*self._kind.quantities(walking, parameters), *added]))
        self._error = model_error(self.qp.terms)
        self._look, self._answer, left = tick_functions(walking, self.qp)
        self._new = np.full(left, np.nan)  # what is left of the tick before, where the step is new
        self._p = np.zeros(walking.system.p.numel())  # parameters of a tick, but for what the path desires
        self._places = {name: place for name, (place, _) in places_of(walking.system.named).items()}
        self._stone = slice(self._places["l_min"].start, self._places["height"].stop)
        self._p[: robot.row.size] = robot.row
        self._nothing = self.qp.no_error()
        self._parameters = parameters
        self.parameters = parameters
        identifies = parameters.adaptation == "identification"
        self._robot = IdentifiedRobots(robot, self._error, parameters.doubt_eps > 0) if identifies else None
        self._estimators = self._kind.estimators(parameters)
        self.policy = policy
        self._terrain = Terrain(self._kind.terrain)
        self._start, self._feet = gait.x_start, Feet(robot)
        self.steps = make_steps(gait, parameters, self._feet)
        self.reset(0)

    @property
    def parameters(self) -> ControllerParameters:
        """Others may be set between two ticks, if they differ in nothing but `DYNAMIC`.

        Raises:
            ControllerError: any other difference needs a new controller.
        """
        return self._parameters

    @parameters.setter
    def parameters(self, new: ControllerParameters) -> None:
        names = type(new).model_fields
        changed = {name for name in names if getattr(new, name) != getattr(self._parameters, name)}
        own = self._kind.estimators(new)  # they keep the gains that they were made with
        dynamic = {*DYNAMIC}.difference(GAINS if own else ())
        if fixed := changed - dynamic:
            raise ControllerError(f"{', '.join(sorted(fixed))}: expected no change, which needs a new controller")
        self._parameters = new
        if changed.intersection(GAINS):
            self._step.last = None  # a difference of V under two gains measures nothing
        for name in GAINS:
            self._p[self._places[name]] = getattr(new, name)

    @property
    def policy(self) -> Policy:
        """The first of the estimators; another one may be set between two ticks.

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

    @property
    def unanswered(self) -> int:
        """Ticks since construction that the chosen solver did not answer itself."""
        return self._answer.unanswered

    def reset(self, seed: int) -> None:
        """Begin an episode: left leg stands; the exploration noise starts from `seed`."""
        self._step = StepState(rng=np.random.default_rng(seed))
        self._held = np.zeros(JOINTS)  # torque of the last tick, left/right order
        self._follow(self.steps.first())
        self._answer.reset()
        if self._robot:
            self._robot.reset()
        for estimator in (self.policy, *self._estimators):
            estimator.reset()

    def rehearse(self) -> None:
        """Compute a tick that nobody walks, so that the first one that counts finds its functions made.

        For a controller that walks in real time. An episode begins with `reset`.
        """
        stone = StonePreview(1, 0.3, 0.4) if self.parameters.terrain == "stones" else None
        self.step(RobotState(0, *self._start, np.zeros((2, 2)), np.zeros(2, dtype=bool), 0, stone))
        self.reset(0)

    def step(self, state: RobotState) -> ControllerOutput:
        """One tick: the torque, and all that others read of it; raises `ControllerError`."""
        self.act(state)
        return self.output()

    def act(self, state: RobotState) -> Acted:
        """What acts in one tick: all that the robot waits for.

        Raises:
            ControllerError: a state of the wrong shape, not finite, or without the preview of the next stone; a policy
                that gives no output error where the objective needs it.
        """
        fault = self.see(state)
        self.decided = self.decide(self.scene)
        self._step.last = self.scene
        return self._act(fault)

    def see(self, state: RobotState) -> str:
        """Take a state in: which leg stands, the step's outputs, `scene`. Why the episode must end, or nothing."""
        self._check(state)
        if is_finite(state.applied):  # in real time it may be another than the one that this gave last
            self._held = state.applied
            self._step.torque = state.applied[SWAP_TORQUE] if self._step.stance is Leg.RIGHT else state.applied
        if self._robot:
            state = state.with_q(self._robot.set_right(state.q[None])[0])
        fault = self._swap_legs(state)
        if not self._step.has_begun:
            self._begin_step(state)
        self.scene = self.look(state)
        return fault

    def look(self, state: RobotState) -> Scene:
        """What is seen of a state, with the present stance leg."""
        p, places, step, stone = self._p, self._places, self._step, state.preview
        x, force, held = np.concatenate((state.q, state.dq)), state.foot_force, self._held
        if step.stance is Leg.RIGHT:
            x, force, held = x[SWAP_X], force[::-1], held[SWAP_TORQUE]
        if stone is not None:
            along, up = self._moved(x, float(force[0, 1])).tolist() if self.parameters.stone_tracking else (0.0, 0.0)
            p[self._stone] = stone.l_min - along, stone.l_max - along, stone.height - up
        if self._robot:
            if self._robot.tune(p[None], places, self.parameters)[0]:
                step.last = None  # as of a change of parameters: V has two gains
            if self.parameters.prediction:
                x = self._robot.predicted(x[None], step.torque[None])[0]
        p[places["force"]], p[places["held"]] = force[0], held
        before = step.last.seen.leaves if step.last and step.last.tick == state.tick - 1 else self._new
        seen = self._look(x, p, self._constraints.row, step.torque, before)
        observation = seen.observation[: self._terrain.observed(stone, self.steps.wanted)]
        of_step = step.torque, step.stance, step.index, (state.tick - step.start_tick) * TICK_SECONDS
        return Scene(x, seen, force, observation, state.tick, *of_step, self._error)

    def decide(self, scene: Scene) -> Decided:
        """mu at a tick, from the estimates of all estimators."""
        total = self._nothing if self.policy.comes_last else self.policy.estimate(scene, self._nothing)
        parts = [total]
        if self._robot:
            of_scene = (each[None] for each in (scene.x, scene.p, scene.force, scene.torque))
            parts.append(self._robot.estimate(np.array([scene.tick]), *of_scene)[0])
            total = total + parts[-1]
        for estimator in self._estimators:
            parts.append(estimator.estimate(scene, total))
            total = total + parts[-1]
        if self.policy.comes_last:
            parts[0] = self.policy.estimate(scene, total)
            total = total + parts[0]
        self.parts, self.estimates = parts, total
        known = () if total.output_error is None else (total.output_error,)
        if not known and self.parameters.objective == "pd_centred" and not self._corrects_input:
            raise ControllerError("objective pd_centred: expected a structured policy, which gives the output error")
        return self._answer(scene.seen.prepared, total.alpha, total.beta, *known)

    def _act(self, fault: str) -> Acted:
        """What was decided, with exploration, within the torque limit."""
        p, step, decided = self.parameters, self._step, self.decided
        values = decided.values
        mu_qp, wanted, omega = values.mu, values.u, NO_NOISE
        if not decided.solved:
            fault, mu_qp = fault or f"no solver answered: {decided.status}", np.zeros(JOINTS)
            wanted = values.control_b
        mu = mu_qp
        if p.sigma > 0:
            omega = p.sigma * step.rng.standard_normal(JOINTS)
            mu = mu_qp + omega
            wanted = values.control_a @ mu + values.control_b
        largest = max(map(abs, wanted.tolist()))
        torque = wanted if largest <= p.torque_limit else np.clip(wanted, -p.torque_limit, p.torque_limit)
        saturated = largest > p.torque_limit + ROUNDING
        if saturated:
            mu = np.linalg.solve(values.control_a, torque - values.control_b)
        step.torque = torque
        self._held = torque[SWAP_TORQUE] if step.stance is Leg.RIGHT else torque
        self._acted = Acted(self._held, mu, mu_qp, omega, saturated, self.policy.version, fault)
        return self._acted

    def output(self) -> ControllerOutput:
        """All of the last tick that others read."""
        p, decided, values = self.parameters, self.decided, self.decided.values
        clf_slack, rescue_slack = decided.layout.slack_sums(values.slack)
        return ControllerOutput(
            **seen_fields(self.scene),
            **vars(self._acted),
            barrier_names=self.barrier_names,
            quantities=self.qp.names,
            alpha=self.estimates.alpha,
            beta=self.estimates.beta,
            clf_slack=clf_slack,
            rescue_slack=rescue_slack,
            active=decided.active,
            rows=decided.layout.names,
            margins=values.row_margin,
            slacks=values.slack,
            multipliers=values.multiplier,
            solver=decided.solver,
            status=decided.status,
            answered=decided.solver == p.qp_solver,
            solve_seconds=decided.seconds,
            objective=p.objective,
            adaptation=p.adaptation,
            identified=self._robot.shown[0] if self._robot else NOTHING,
            adapted=flat(self.parts[1]) if self._robot else NOTHING,
        )

    def _moved(self, x: Array, normal_force: float) -> Array:
        """How far the stance foot has moved since it came down, (2,), m: a foot that carries the robot stands."""
        step, carries = self._step, normal_force > CARRIED
        if not (carries and step.carries):
            step.moved = self._feet(x[:DOF]).stance - step.place
        step.carries = carries
        return step.moved

    def _relabel(self, values: Array) -> Array:
        return values[SWAP_STATE] if self._step.stance is Leg.RIGHT else values

    def _swap_legs(self, state: RobotState) -> str:
        """Swap stance and swing at a touchdown; a fault where this and the simulator's count disagree."""
        p, step = self.parameters, self._step
        swing = step.stance.other
        seconds = (state.tick - step.start_tick) * TICK_SECONDS
        is_late = state.contact[swing] and seconds > p.swap_time
        if is_late and self._constraints.phase(self._relabel(state.q)) > p.swap_phase:
            step.stance, step.index, step.start_tick, step.seconds_before = swing, step.index + 1, state.tick, seconds
            step.torque, step.last, step.has_begun = NO_TORQUE, None, False
        if state.touchdowns != step.index:
            return f"contact disagreement: {state.touchdowns} touchdowns, {step.index} steps"
        return ""

    def _begin_step(self, state: RobotState) -> None:
        """The step's outputs, from where the feet stand and the stone that is seen."""
        q_s, dq_s = self._relabel(state.q), self._relabel(state.dq)
        feet = self._feet(q_s)
        taken, self._step.place = -float(feet.swing[0]), feet.stance
        self._step.moved, self._step.carries = np.zeros(2), True
        touchdown = Touchdown(q_s, dq_s, taken, self._step.seconds_before, state.preview)
        self._follow(self.steps.begin(touchdown))
        self._step.has_begun = True

    def _follow(self, constraints: VirtualConstraints) -> None:
        """From now on these are the outputs."""
        self._constraints = constraints
        self._p[self._places["phase_scale"]] = constraints.scale
        self._p[self._places["step_length"]] = self.steps.wanted or 0.0

    def _check(self, state: RobotState) -> None:
        q, dq = state.q, state.dq
        if not (q.shape == dq.shape == (DOF,) and is_finite(q) and is_finite(dq)):
            wrong = "dq" if q.shape == (DOF,) and is_finite(q) else "q"
            raise ControllerError(f"state.{wrong} = {getattr(state, wrong)}: expected {DOF} finite values")
        self._terrain.check(state)
