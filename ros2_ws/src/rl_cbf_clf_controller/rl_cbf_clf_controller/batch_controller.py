"""The controller's tick of N robots at once, by the functions of `controller.py`, see `batch_functions.py`.

Each robot's torque is to the bit what a `Controller` of its own would give.

State, outputs, rows, QP, policy and torque are computed for all robots together. What happens once a step, and an
estimator that learns within the walk or knows its plant (the identified robot, L1, an oracle), goes robot by robot.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import NumpyFunction, Values
from cbf_clf_qp.qp import ROUNDING as ACTIVE
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import DOF, JOINTS, SWAP_STATE, SWAP_TORQUE, TICK_SECONDS, Array, Leg

from rl_cbf_clf_controller.batch_functions import BatchFunction, answers, batch_with_daqp
from rl_cbf_clf_controller.controller import CARRIED, NO_TORQUE, ROUNDING, Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput, flat, seen_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import LearnedPolicy, Policy
from rl_cbf_clf_controller.residual_policy import Memory, ResidualPolicy
from rl_cbf_clf_controller.scene import ControllerError, Scene
from rl_cbf_clf_controller.step_outputs import Touchdown
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints


@dataclass(frozen=True)
class BatchScene:
    """What is seen of N robots, a row each; see `Scene`.

    `errors`: why the controller refuses a robot's state, `faults`: why its episode must end, both by its number.
    """

    x: Array
    seen: Values
    force: Array
    observation: Array
    tick: Array
    torque: Array
    stance: Array
    step_index: Array
    step_time: Array
    model_error: NumpyFunction
    errors: dict[int, str]
    faults: dict[int, str]

    def __getitem__(self, i: int) -> Scene:
        """Of robot `i`."""
        return Scene(
            self.x[i],
            self.seen[i],
            self.force[i],
            self.observation[i],
            int(self.tick[i]),
            self.torque[i],
            Leg(int(self.stance[i])),
            int(self.step_index[i]),
            float(self.step_time[i]),
            self.model_error,
        )


@dataclass(frozen=True)
class BatchOutput:
    """What a tick decides, a row a robot; see `ControllerOutput`. `torque` (N, 4): left/right order, saturated, N m.

    `estimates`: of all estimators; `policies`: whose they are among others; `own`: further fields, by name.
    """

    scene: BatchScene
    torque: Array
    decided: Decided
    estimates: Estimates
    mu: Array
    mu_qp: Array
    omega: Array
    saturated: Array
    quantities: tuple[str, ...]
    barrier_names: tuple[str, ...]
    policies: list[Policy]
    parameters: ControllerParameters
    own: dict[str, Any]

    def __getitem__(self, i: int) -> ControllerOutput:
        """Of robot `i`."""
        decided, layout = self.decided, self.decided.layout
        slack, margin = decided.values.slack[i], decided.values.margin[i].tolist()
        clf_slack, rescue_slack = layout.slack_sums(slack)
        return ControllerOutput(
            torque=self.torque[i],
            mu=self.mu[i],
            mu_qp=self.mu_qp[i],
            omega=self.omega[i],
            alpha=self.estimates.alpha[i],
            beta=self.estimates.beta[i],
            clf_slack=clf_slack,
            rescue_slack=rescue_slack,
            active=tuple([name for name, each in zip(layout.names, margin, strict=True) if each < ACTIVE]),
            rows=layout.names,
            margins=decided.values.row_margin[i],
            slacks=slack,
            multipliers=decided.values.multiplier[i],
            saturated=bool(self.saturated[i]),
            solver=decided.solver[i],
            status=decided.status[i],
            answered=decided.solver[i] == self.parameters.qp_solver,
            solve_seconds=decided.seconds,
            policy_version=self.policies[i].version,
            fault=self.scene.faults.get(i, ""),
            quantities=self.quantities,
            objective=self.parameters.objective,
            adaptation=self.parameters.adaptation,
            **seen_fields(self.scene[i]),
            barrier_names=self.barrier_names,
            **{name: values[i] for name, values in self.own.items()},
        )


class BatchController:
    """N robots under copies of one `controller`, each with its policy; several may have the same one.

    One object serves one thread.
    """

    def __init__(self, controller: Controller, policies: Sequence[Policy]) -> None:
        n, tick = len(policies), controller.qp
        self._one, self.policies = controller, list(policies)
        self.parameters = controller.parameters
        self._steps = [controller.steps.another() for _ in policies]
        self._robots = controller._robot.another(n) if controller._robot else None
        self._estimators = [[each.another() for each in controller._estimators] for _ in policies]
        self._acts_at_once = isinstance(policies[0], LearnedPolicy) and len(set(map(id, policies))) == 1
        self._answers = [controller._answer.another() for _ in policies]
        self._look, self._with_daqp = BatchFunction(controller._look), batch_with_daqp(controller._answer)
        self._feet = BatchFunction(controller._feet.function)
        self._rngs = [np.random.default_rng(0) for _ in policies]
        self._constraints = [steps.first() for steps in self._steps]
        self._stance, self._index, self._start_tick = np.zeros((3, n), dtype=int)
        self._orders: dict[int, Array] = {}  # of the columns, by their number, for the legs that stand
        self._checked = np.full((n, 3), np.nan)  # stones
        self._has_begun, self._seconds_before = np.zeros(n, dtype=bool), np.zeros(n)
        self._torque, self._held, self._place = np.tile(NO_TORQUE, (n, 1)), np.zeros((n, JOINTS)), np.zeros((n, 2))
        self._moved, self._carries = np.zeros((n, 2)), np.ones(n, dtype=bool)
        self._path = np.array([each.row for each in self._constraints])
        self._p = np.tile(controller._p, (n, 1))
        self._last_tick, self._left = np.full(n, -2), np.tile(controller._new, (n, 1))
        self._none = Estimates.of_many([tick.no_error()])
        self._no_output_error = tick.terms.inputs, tick.terms.inputs + 1
        self._residual = policies[0] if isinstance(policies[0], ResidualPolicy) else None
        self._memory = Memory.of(n)

    def reset(self, i: int, seed: int) -> None:
        """Begin an episode of robot `i`; see `Controller.reset`."""
        self._rngs[i] = np.random.default_rng(seed)
        self._stance[i] = self._index[i] = self._start_tick[i] = 0
        self._orders.clear()
        self._seconds_before[i], self._torque[i], self._last_tick[i] = np.nan, NO_TORQUE, -2
        self._has_begun[i], self._held[i] = False, 0.0
        self._follow(i, self._steps[i].first())
        self._answers[i].reset()
        self._memory.forget(i)
        if self._robots:
            self._robots.reset(i)
        for estimator in (self.policies[i], *self._estimators[i]):
            estimator.reset()

    def keep(self, rows: Array) -> None:
        """Go on with some of the robots, by number."""
        for name, value in vars(self).items():
            if name in PER_ROBOT:
                setattr(self, name, value[rows] if isinstance(value, np.ndarray) else [value[i] for i in rows])
        if self._robots:
            self._robots.keep(rows)
        self._memory.keep(rows)
        self._orders.clear()

    def step(self, states: RobotStates) -> BatchOutput:
        """The torques for one tick; see `Controller.step`. Those of a state that is refused mean nothing."""
        return self.decide(self.look(states))

    def look(self, states: RobotStates) -> BatchScene:
        """What is seen of the states, after those robots have changed legs that came down; see `Controller.look`."""
        q, dq, errors = states.q, states.dq, self._refused(states)
        if errors:
            known = np.array([[i not in errors] for i in range(len(states))])
            q, dq = np.where(known, q, 0.0), np.where(known, dq, 0.0)
        is_known = np.isfinite(states.applied.sum(axis=1))
        if is_known.any():
            self._held = np.where(is_known[:, None], states.applied, self._held)
            self._torque = np.where(is_known[:, None], self._by_stance(states.applied, SWAP_TORQUE), self._torque)
        if self._robots:
            q = self._robots.set_right(q)
        faults = self._swap_legs(states, q)
        x = np.concatenate([self._by_stance(q, SWAP_STATE), self._by_stance(dq, SWAP_STATE)], axis=1)
        for i in (~self._has_begun).nonzero()[0].tolist():
            self._begin_step(i, x[i], states)
        p, places, parameters = self._p, self._one._places, self._one.parameters
        force = np.where(self._stance[:, None, None], states.foot_force[:, ::-1], states.foot_force)
        p[:, places["force"]], p[:, places["held"]] = force[:, 0], self._by_stance(self._held, SWAP_TORQUE)
        if parameters.stone_tracking and parameters.terrain == "stones":
            self._track(x, force[:, 0, 1])
        sees_stone = ~np.isnan(states.stones[:, :1])
        np.copyto(p[:, self._one._stone], states.stones - self._moved[:, (0, 0, 1)], where=sees_stone)
        if self._robots:
            self._left[self._robots.tune(p, places, parameters)] = np.nan
            if parameters.prediction:
                x = self._robots.predicted(x, self._torque)
        self._left[self._last_tick != states.tick - 1] = np.nan
        seen = self._look(x, p, self._path, self._torque, self._left)
        stone = next((each for each in states.previews if each), None)
        observed = self._one._terrain.observed(stone, self._steps[0].wanted)
        return BatchScene(
            x=x,
            seen=seen,
            force=force,
            observation=seen.observation[:, :observed],
            tick=states.tick,
            torque=self._torque.copy(),
            stance=self._stance.copy(),
            step_index=self._index.copy(),
            step_time=(states.tick - self._start_tick) * TICK_SECONDS,
            model_error=self._one._error,
            errors=errors,
            faults=faults,
        )

    def decide(self, scene: BatchScene, estimates: Estimates | None = None) -> BatchOutput:
        """The torques at these scenes, from all estimators; `estimates` take the place of the policy's."""
        parts, total = self._estimated(scene, estimates)
        if self._residual:
            parts[0] = self._residual.of_many(self._memory, scene, total)
            total = total + parts[0]
        error = total.output_error
        if error is None:
            if self._one.parameters.objective == "pd_centred" and not self._one._corrects_input:
                raise ControllerError(
                    "objective pd_centred: expected a structured policy, which gives the output error"
                )
            error = np.zeros((len(scene.x), *self._no_output_error))
        decided = answers(self._answers, self._with_daqp, scene.seen.prepared, total.alpha, total.beta, error)
        output = self._output(scene, decided, total, parts)
        self._last_tick, self._left = scene.tick, scene.seen.leaves.copy()
        return output

    def _estimated(self, scene: BatchScene, given: Estimates | None) -> tuple[list[Estimates], Estimates]:
        """Of the policy, then of each other estimator; and in all."""
        policy, n = self.policies[0], len(scene.x)
        if self._residual:
            q, m = self._none.beta.shape[-1], self._no_output_error[0]
            given = Estimates(np.zeros((n, q, m)), np.zeros((n, q)), np.zeros((n, *self._no_output_error)))
        elif given is None and self._acts_at_once and isinstance(policy, LearnedPolicy):
            given = policy.act_of_many(scene.observation, scene.seen.LgV)
        elif given is None:
            nothing = self._one.qp.no_error()
            given = Estimates.of_many([each.estimate(scene[i], nothing) for i, each in enumerate(self.policies)])
        parts, total = [given], self._none + given
        if self._robots:
            of_scene = scene.tick, scene.x, scene.seen.p, scene.force, scene.torque
            parts.append(self._robots.estimate(*of_scene))
            total = total + parts[-1]
        for estimators in zip(*self._estimators, strict=True):  # of all robots
            found = [each.estimate(scene[i], total[i]) for i, each in enumerate(estimators)]
            parts.append(Estimates.of_many(found))
            total = total + parts[-1]
        return parts, total

    def _output(self, scene: BatchScene, decided: Decided, total: Estimates, parts: list[Estimates]) -> BatchOutput:
        parameters, values, n = self._one.parameters, decided.values, len(scene.x)
        a, b = values.control_a, values.control_b
        mu_qp, wanted, omega, faults = values.mu, values.u, np.zeros((n, JOINTS)), scene.faults
        for i in (~decided.solved).nonzero()[0].tolist():
            faults.setdefault(i, f"no solver answered: {decided.status[i]}")
            mu_qp[i] = 0.0
            wanted[i] = a[i] @ mu_qp[i] + b[i]
        mu = mu_qp
        if parameters.sigma > 0:
            omega = parameters.sigma * np.array([rng.standard_normal(JOINTS) for rng in self._rngs])
            mu = mu_qp + omega
            wanted = np.array([a[i] @ mu[i] + b[i] for i in range(n)])
        limit = parameters.torque_limit
        torque = wanted.clip(-limit, limit)
        saturated = np.abs(wanted).max(axis=1) > limit + ROUNDING
        if saturated.any():
            mu = mu.copy()
            for i in saturated.nonzero()[0].tolist():
                mu[i] = np.linalg.solve(a[i], torque[i] - b[i])
        self._torque = torque
        own = dict[str, Any]()
        if self._robots:
            own |= {"identified": self._robots.shown, "adapted": [flat(parts[1][i]) for i in range(n)]}
        torque = self._by_stance(torque, SWAP_TORQUE)
        self._held = torque.copy()  # which a reset changes, and not what has been handed out
        names = self._one.qp.names, self._one.barrier_names
        last = *names, list(self.policies), parameters, own
        return BatchOutput(scene, torque, decided, total, mu, mu_qp, omega, saturated, *last)

    def _by_stance(self, values: Array, swapped: Any) -> Array:
        """Columns from left/right to stance/swing order and back."""
        n, columns = values.shape
        if columns not in self._orders:
            order = np.where(self._stance[:, None], swapped, np.arange(columns))
            self._orders[columns] = order + columns * np.arange(n)[:, None]
        return values.ravel()[self._orders[columns]]

    def _refused(self, states: RobotStates) -> dict[int, str]:
        """What `Controller` refuses, by robot."""
        refused, unsure = {}, ~(np.isfinite(states.q.sum(axis=1)) & np.isfinite(states.dq.sum(axis=1)))
        if self._one.parameters.terrain == "stones":
            unsure |= (states.stones != self._checked).any(axis=1)
        for i in unsure.nonzero()[0].tolist():
            try:
                self._one._check(states[i])
                self._checked[i] = states.stones[i]
            except ControllerError as error:
                refused[i] = f"controller error: {error}"
        return refused

    def _swap_legs(self, states: RobotStates, q: Array) -> dict[int, str]:
        """Swap stance and swing at a touchdown; faults where this and the simulator's count disagree."""
        parameters = self._one.parameters
        has_come_down = states.contact[np.arange(len(states)), 1 - self._stance]
        for i in has_come_down.nonzero()[0].tolist():
            seconds = (int(states.tick[i]) - int(self._start_tick[i])) * TICK_SECONDS
            if not seconds > parameters.swap_time:
                continue
            q_s = q[i, SWAP_STATE] if self._stance[i] else q[i]
            if self._constraints[i].phase(q_s) > parameters.swap_phase:
                self._stance[i] = 1 - self._stance[i]
                self._orders.clear()
                self._index[i] += 1
                self._start_tick[i], self._seconds_before[i] = states.tick[i], seconds
                self._torque[i], self._last_tick[i], self._has_begun[i] = NO_TORQUE, -2, False
        wrong = (states.touchdowns != self._index).nonzero()[0].tolist()
        return {i: f"contact disagreement: {states.touchdowns[i]} touchdowns, {self._index[i]} steps" for i in wrong}

    def _track(self, x: Array, normal_force: Array) -> None:
        """See `Controller._moved`."""
        carries = normal_force > CARRIED
        stands = (carries & self._carries)[:, None]
        if not stands.all():
            moved = self._feet(x[:, :DOF], *(each.ravel() for each in self._one._feet.lengths)).stance - self._place
            self._moved = np.where(stands, self._moved, moved)
        self._carries = carries

    def _begin_step(self, i: int, x: Array, states: RobotStates) -> None:
        """See `Controller`."""
        seconds = None if np.isnan(self._seconds_before[i]) else float(self._seconds_before[i])
        feet = self._one._feet(x[:DOF])
        taken, self._place[i] = -float(feet.swing[0]), feet.stance
        self._moved[i], self._carries[i] = 0.0, True
        self._follow(i, self._steps[i].begin(Touchdown(x[:DOF], x[DOF:], taken, seconds, states.previews[i])))
        self._has_begun[i] = True

    def _follow(self, i: int, constraints: VirtualConstraints) -> None:
        """From now on robot `i` has these outputs."""
        self._constraints[i] = constraints
        self._path[i], places = constraints.row, self._one._places
        self._p[i, places["phase_scale"]] = constraints.scale
        self._p[i, places["step_length"]] = self._steps[i].wanted or 0.0


PER_ROBOT = {
    *("policies", "_steps", "_estimators", "_rngs", "_constraints", "_stance", "_index", "_start_tick", "_has_begun"),
    *("_answers", "_seconds_before", "_checked", "_torque", "_held", "_place", "_moved", "_carries", "_path", "_p"),
    *("_last_tick", "_left"),
}
