"""The controller of one tick: state in, torque out. Read `cbf_clf_qp.tick` first, then this, then `recipes.py`.

    relabel to stance/swing -> scene, nominal dynamics -> terms
    -> the tick of `cbf_clf_qp`: estimates, rows, QP -> mu -> exploration -> torque, saturated (`act`) -> `output`

Which leg stands, exploration and what is kept from tick to tick are here; what a controller constrains is its recipe.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates, model_error
from cbf_clf_qp.functions import OFTEN, one_at_a_time, places_of
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
from rl_cbf_clf_controller.step_outputs import Steps, Touchdown, make_steps
from rl_cbf_clf_controller.tick_functions import tick_functions
from rl_cbf_clf_controller.uncertainty import STATE_OBSERVATION
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints
from rl_cbf_clf_controller.walking import GAINS, Walking

ROUNDING = 1e-6  # N m, by which the QP may be over the limit
NO_TORQUE = no_torque()
SWAP_X = np.concatenate([SWAP_STATE, DOF + SWAP_STATE])
NO_NOISE = np.zeros(JOINTS)
CARRIED = 20.0  # N; a foot that presses less may be falling
FARTHEST_STONE = 2.0  # m
HIGHEST_STONE = 0.5  # m, up or down
DYNAMIC = ("sigma", "swap_time", "swap_phase", *GAINS)  # parameters that may change between two ticks

Further = Callable[[Walking], Sequence[Constrained]]  # quantities of RABBIT's symbols


def nothing_further(walking: Walking) -> Sequence[Constrained]:
    """The controller's own quantities are all."""
    return ()


class Stepping:
    """The steps of one robot: which leg stands since which tick, how many have been taken, the outputs of this one.

    `steps`: a gait's, or a library's; `constraints`: the present outputs, of this step where it `has_begun`; `rng`: of
    the exploration.
    """

    constraints: VirtualConstraints
    rng: np.random.Generator

    def __init__(self, steps: Steps, feet: Feet) -> None:
        self.steps, self._feet = steps, feet
        self.reset(0)

    def another(self) -> "Stepping":
        """For another robot in the same thread."""
        return Stepping(self.steps.another(), self._feet)

    def reset(self, seed: int) -> None:
        """Begin an episode: left leg stands; the exploration noise starts from `seed`."""
        self.stance, self.index, self.start_tick = Leg.LEFT, 0, 0
        self._seconds_before: float | None = None  # that the last step took
        self._place, self._moved, self._carries = np.zeros(2), np.zeros(2), True  # of the stance foot
        self.has_begun, self.rng, self.constraints = False, np.random.default_rng(seed), self.steps.first()

    def swaps(self, tick: int, contact: Array, q: Array, parameters: ControllerParameters) -> bool:
        """Swap stance and swing at a touchdown: whether it was one. `contact` (2,) and q (7,): left/right order."""
        swing, seconds = self.stance.other, (tick - self.start_tick) * TICK_SECONDS
        if not (contact[swing] and seconds > parameters.swap_time):
            return False
        if not self.constraints.phase(q[SWAP_STATE] if self.stance is Leg.RIGHT else q) > parameters.swap_phase:
            return False
        self.stance, self.index, self.start_tick, self._seconds_before = swing, self.index + 1, tick, seconds
        self.has_begun = False
        return True

    def begin(self, x: Array, stone: StonePreview | None, p: Array, places: Mapping[str, slice]) -> None:
        """A step, from the state `x` (14,), stance/swing order, towards the stone that is seen; into parameters `p`."""
        feet = self._feet(x[:DOF])
        taken, self._place = -float(feet.swing[0]), feet.stance
        self._moved, self._carries, self.has_begun = np.zeros(2), True, True
        self.constraints = self.steps.begin(Touchdown(x[:DOF], x[DOF:], taken, self._seconds_before, stone))
        self.follow(p, places)

    def follow(self, p: Array, places: Mapping[str, slice]) -> None:
        """The present outputs, into the parameters `p` of a tick."""
        p[places["phase_scale"]] = self.constraints.scale
        p[places["step_length"]] = self.steps.wanted or 0.0

    def moved(self, x: Array, normal_force: float) -> Array:
        """How far the stance foot has moved since it came down, (2,), m: a foot that carries the robot stands."""
        carries = normal_force > CARRIED
        if not (carries and self._carries):
            self._moved = self._feet(x[:DOF]).stance - self._place
        self._carries = carries
        return self._moved

    def disagrees(self, touchdowns: int) -> str:
        """With the simulator's count: a fault; empty where it does not."""
        is_wrong = touchdowns != self.index
        return f"contact disagreement: {touchdowns} touchdowns, {self.index} steps" if is_wrong else ""


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
    _last: Scene | None

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
        self._needs_output_error = parameters.objective == "pd_centred" and not self._kind.problem.corrects_input
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
        self._start, feet = gait.x_start, Feet(robot)
        self.steps = make_steps(gait, parameters, feet)
        self._step = Stepping(self.steps, feet)
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
            self._last = None  # a difference of V under two gains measures nothing
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
        self._step.reset(seed)
        self._step.follow(self._p, self._places)
        self._torque, self._held = NO_TORQUE, np.zeros(JOINTS)  # of the last tick; the latter in left/right order
        self._last = None  # scene of this step
        self._answer.reset()
        if self._robot:
            self._robot.reset()
        for estimator in (self.policy, *self._estimators):
            estimator.reset()

    def rehearse(self) -> None:
        """Compute ticks that nobody walks, so that the first one that counts finds its functions made.

        And written as C, which takes as long as several ticks; they are compiled meanwhile. For a controller that walks
        in real time. An episode begins with `reset`.
        """
        stone = StonePreview(1, 0.3, 0.4) if self.parameters.terrain == "stones" else None
        for _ in range(OFTEN):
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
        self._last = self.scene
        return self._act(fault)

    def see(self, state: RobotState) -> str:
        """Take a state in: which leg stands, the step's outputs, `scene`. Why the episode must end, or nothing."""
        self._check(state)
        step = self._step
        if is_finite(state.applied):  # in real time it may be another than the one that this gave last
            self._held = state.applied
            self._torque = state.applied[SWAP_TORQUE] if step.stance is Leg.RIGHT else state.applied
        if self._robot:
            state = state.with_q(self._robot.set_right(state.q[None])[0])
        if step.swaps(state.tick, state.contact, state.q, self.parameters):
            self._torque, self._last = NO_TORQUE, None
        if not step.has_begun:
            step.begin(self._by_stance(state), state.preview, self._p, self._places)
        self.scene = self.look(state)
        return step.disagrees(state.touchdowns)

    def look(self, state: RobotState) -> Scene:
        """What is seen of a state, with the present stance leg."""
        p, places, step, stone = self._p, self._places, self._step, state.preview
        x, force, held = self._by_stance(state), state.foot_force, self._held
        if step.stance is Leg.RIGHT:
            force, held = force[::-1], held[SWAP_TORQUE]
        if stone is not None and self.parameters.terrain == "stones":  # on flat ground nobody has checked it
            along, up = step.moved(x, float(force[0, 1])).tolist() if self.parameters.stone_tracking else (0.0, 0.0)
            p[self._stone] = stone.l_min - along, stone.l_max - along, stone.height - up
        if self._robot:
            if self._robot.tune(p[None], places, self.parameters)[0]:
                self._last = None  # as of a change of parameters: V has two gains
            if self.parameters.prediction:
                x = self._robot.predicted(x[None], self._torque[None])[0]
        p[places["force"]], p[places["held"]] = force[0], held
        before = self._last.seen.leaves if self._last and self._last.tick == state.tick - 1 else self._new
        seen = self._look(x, p, step.constraints.row, self._torque, before)
        observation = seen.observation[: self.observed(stone, self.steps)]
        of_step = self._torque, step.stance, step.index, (state.tick - step.start_tick) * TICK_SECONDS
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
        self.check_estimates(total)
        known = () if total.output_error is None else (total.output_error,)
        return self._answer(scene.seen.prepared, total.alpha, total.beta, *known)

    def check_estimates(self, total: Estimates) -> None:
        """Raises `ControllerError` where the objective needs an output error, and none is known."""
        if total.output_error is None and self._needs_output_error:
            raise ControllerError("objective pd_centred: expected a structured policy, which gives the output error")

    def _act(self, fault: str) -> Acted:
        """What was decided, with exploration, within the torque limit."""
        p, step, decided, values = self.parameters, self._step, self.decided, self.decided.values
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
        if not (is_finite(torque) and is_finite(mu)):
            fault, saturated = fault or not_finite(wanted), False
            torque, mu, mu_qp = np.zeros((3, JOINTS))
        self._torque = torque
        self._held = torque[SWAP_TORQUE] if step.stance is Leg.RIGHT else torque
        self._acted = Acted(self._held, mu, mu_qp, omega, saturated, self.policy.version, fault)
        return self._acted

    def output(self) -> ControllerOutput:
        """All of the last tick that others read."""
        known = (self._robot.shown[0], flat(self.parts[1])) if self._robot else (NOTHING, NOTHING)
        return self.output_of(self.scene, self._acted, self.decided, self.estimates, *known)

    def output_of(
        self,
        scene: Scene,
        acted: Acted,
        decided: Decided,
        estimates: Estimates,
        identified: Array = NOTHING,
        adapted: Array = NOTHING,
    ) -> ControllerOutput:
        """That of a tick, of these parts."""
        values = decided.values
        clf_slack, rescue_slack = decided.layout.slack_sums(values.slack)
        return ControllerOutput(
            **seen_fields(scene),
            **vars(acted),
            barrier_names=self.barrier_names,
            quantities=self.qp.names,
            alpha=estimates.alpha,
            beta=estimates.beta,
            clf_slack=clf_slack,
            rescue_slack=rescue_slack,
            active=decided.active,
            rows=decided.layout.names,
            margins=values.row_margin,
            slacks=values.slack,
            multipliers=values.multiplier,
            solver=decided.solver,
            status=decided.status,
            answered=decided.is_by(self.parameters.qp_solver),
            solve_seconds=decided.seconds,
            objective=self.parameters.objective,
            adaptation=self.parameters.adaptation,
            identified=identified,
            adapted=adapted,
        )

    def _by_stance(self, state: RobotState) -> Array:
        """(q, q') (14,) in stance/swing order."""
        x = np.concatenate((state.q, state.dq))
        return x[SWAP_X] if self._step.stance is Leg.RIGHT else x

    def _check(self, state: RobotState) -> None:
        q, dq = state.q, state.dq
        if not (q.shape == dq.shape == (DOF,) and is_finite(q) and is_finite(dq)):
            wrong = "dq" if q.shape == (DOF,) and is_finite(q) else "q"
            raise ControllerError(f"state.{wrong} = {getattr(state, wrong)}: expected {DOF} finite values")
        if self.parameters.terrain == "stones":
            check_stone(state.preview, state.touchdowns + 1)

    def observed(self, stone: StonePreview | None, steps: Steps) -> int:
        """How many of the observations there are: the robot's; on stones the near edge, and a library's step length."""
        is_seen = stone is not None and self.parameters.terrain == "stones"
        return len(STATE_OBSERVATION) + (1 + len(steps.wanted) if is_seen else 0)


def not_finite(torque: Array) -> str:
    """Why an episode ends whose state is finite, and too large for the model."""
    return f"torque not finite: {torque.tolist()} N m"


def check_stone(stone: StonePreview | None, index: int) -> None:
    """Raises `ControllerError` where a preview is not that of the stone of this index."""
    if stone is None or stone.index != index:
        raise ControllerError(f"state.preview = {stone}: expected stone {index}")
    if not 0 < stone.l_min < stone.l_max < FARTHEST_STONE:
        raise ControllerError(f"state.preview = {stone}: expected 0 < l_min < l_max < {FARTHEST_STONE:g} m")
    if not abs(stone.height) <= HIGHEST_STONE:
        raise ControllerError(f"state.preview = {stone}: expected a height of at most {HIGHEST_STONE:g} m")
