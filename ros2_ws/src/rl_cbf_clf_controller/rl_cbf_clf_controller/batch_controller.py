"""The controller's tick of N robots at once, by the functions of `controller.py`, see `batch_functions.py`.

Each robot's torque is to the bit what a `Controller` of its own would give.

State, outputs, rows, QP, policy and torque are computed for all robots together. What happens once a step, and an
estimator that learns within the walk or knows its plant (the identified robot, L1, an oracle), goes robot by robot.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import JOINTS, SWAP_STATE, SWAP_TORQUE, TICK_SECONDS, Array, Leg

from rl_cbf_clf_controller.batch_functions import BatchFunction, answers
from rl_cbf_clf_controller.controller import NO_TORQUE, ROUNDING, Controller, not_finite
from rl_cbf_clf_controller.controller_output import Acted, ControllerOutput, flat
from rl_cbf_clf_controller.policy import LearnedPolicy, Policy
from rl_cbf_clf_controller.residual_policy import Memory, ResidualPolicy
from rl_cbf_clf_controller.scene import ControllerError, Estimator, Scene


@dataclass
class BatchScene(Scene):
    """What is seen of N robots.

    `errors`: why the controller refuses a robot's state, `faults`: why its episode must end, both by its number.
    """

    errors: dict[int, str]
    faults: dict[int, str]


@contextmanager
def refusing(errors: dict[int, str], i: int) -> Iterator[None]:
    """What a controller of its own would raise becomes the first error of robot `i`; the others go on."""
    try:
        yield
    except (ControllerError, np.linalg.LinAlgError) as error:
        errors.setdefault(i, f"controller error: {error}")


@dataclass(frozen=True)
class BatchOutput:
    """What a tick decides, a row a robot; see `ControllerOutput`. `torque` (N, 4): left/right order, saturated, N m.

    `acted`: mu, mu_qp, omega, saturated and the policies; `estimates`: of all estimators; `known`: what is known of the
    identified robots and their estimates, where there are such.
    """

    one: Controller
    scene: BatchScene
    torque: Array
    decided: Decided
    estimates: Estimates
    acted: tuple[Any, ...]
    known: tuple[Any, ...]

    def __getitem__(self, i: int) -> ControllerOutput:
        """Of robot `i`."""
        mu, mu_qp, omega, saturated, policy = (each[i] for each in self.acted)
        fault = self.scene.faults.get(i, "")
        acted = Acted(self.torque[i], mu, mu_qp, omega, bool(saturated), policy.version, fault)
        known = (each[i] for each in self.known)
        return self.one.output_of(self.scene[i], acted, self.decided[i], self.estimates[i], *known)


class BatchController:
    """N robots under copies of one `controller`, each with its policy; several may have the same one.

    One object serves one thread.
    """

    def __init__(self, controller: Controller, policies: Sequence[Policy]) -> None:
        n, tick = len(policies), controller.qp
        self._one, self.policies = controller, list(policies)
        self.parameters = controller.parameters
        self._steps = [controller._step.another() for _ in policies]
        self._robots = controller._robot.another(n) if controller._robot else None
        self._estimators = [[each.another() for each in controller._estimators] for _ in policies]
        self._acts_at_once = isinstance(policies[0], LearnedPolicy) and len(set(map(id, policies))) == 1
        self._answers = [controller._answer.another() for _ in policies]
        self._look, self._with_daqp = BatchFunction(controller._look), BatchFunction(controller._answer.with_daqp)
        self._stance = np.zeros(n, dtype=int)
        self._orders: dict[int, Array] = {}  # of the columns, by their number, for the legs that stand
        self._checked: list[Any] = [None] * n  # preview and touchdowns, of each robot
        self._torque, self._held = np.tile(NO_TORQUE, (n, 1)), np.zeros((n, JOINTS))
        self._path = np.array([each.constraints.row for each in self._steps])
        self._p = np.tile(controller._p, (n, 1))
        self._last_tick, self._left = np.full(n, -2), np.tile(controller._new, (n, 1))
        self._none = Estimates.of_many([tick.no_error()])
        self._no_output_error = tick.terms.inputs, tick.terms.inputs + 1
        self._residual = policies[0] if isinstance(policies[0], ResidualPolicy) else None
        self._memory = Memory.of(n)

    def reset(self, i: int, seed: int) -> None:
        """Begin an episode of robot `i`; see `Controller.reset`."""
        self._steps[i].reset(seed)
        self._steps[i].follow(self._p[i], self._one._places)
        self._path[i], self._stance[i] = self._steps[i].constraints.row, Leg.LEFT
        self._orders.clear()
        self._torque[i], self._held[i], self._last_tick[i] = NO_TORQUE, 0.0, -2
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
        self._swap_legs(states, q)
        x = np.concatenate([self._by_stance(q, SWAP_STATE), self._by_stance(dq, SWAP_STATE)], axis=1)
        p, places, parameters = self._p, self._one._places, self._one.parameters
        for i, step in enumerate(self._steps):
            if not step.has_begun and i not in errors:
                with refusing(errors, i):
                    step.begin(x[i], states.previews[i], p[i], places)
                    self._path[i] = step.constraints.row
        force = np.where(self._stance[:, None, None], states.foot_force[:, ::-1], states.foot_force)
        p[:, places["force"]], p[:, places["held"]] = force[:, 0], self._by_stance(self._held, SWAP_TORQUE)
        if parameters.terrain == "stones":
            stones, sees_stone = states.stones, ~np.isnan(states.stones[:, :1])
            if parameters.stone_tracking:
                stand = zip(self._steps, x, force[:, 0, 1].tolist(), strict=True)
                stones = stones - np.array([step.moved(*where) for step, *where in stand])[:, (0, 0, 1)]
            np.copyto(p[:, self._one._stone], stones, where=sees_stone)
        if self._robots:
            self._left[self._robots.tune(p, places, parameters)] = np.nan
            if parameters.prediction:
                x = self._robots.predicted(x, self._torque)
        self._left[self._last_tick != states.tick - 1] = np.nan
        seen = self._look(x, p, self._path, self._torque, self._left)
        touchdowns = states.touchdowns.tolist()
        stone = next((each for each in states.previews if each), None)
        observed = self._one.observed(stone, self._steps[0].steps)
        return BatchScene(
            x=x,
            seen=seen,
            force=force,
            observation=seen.observation[:, :observed],
            tick=states.tick,
            torque=self._torque.copy(),
            stance=self._stance.copy(),
            step_index=np.array([step.index for step in self._steps]),
            step_time=(states.tick - [step.start_tick for step in self._steps]) * TICK_SECONDS,
            model_error=self._one._error,
            errors=errors,
            faults={i: fault for i, step in enumerate(self._steps) if (fault := step.disagrees(touchdowns[i]))},
        )

    def decide(self, scene: BatchScene, estimates: Estimates | None = None) -> BatchOutput:
        """The torques at these scenes, from all estimators; `estimates` take the place of the policy's."""
        parts, total = self._estimated(scene, estimates)
        if self._residual:
            parts[0] = self._residual.of_many(self._memory, scene, total)
            total = total + parts[0]
        for i in range(len(scene.x)) if total.output_error is None else ():
            with refusing(scene.errors, i):
                self._one.check_estimates(total)
        error = np.zeros((len(scene.x), *self._no_output_error)) if total.output_error is None else total.output_error
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
            given = self._each(self.policies, scene, [nothing] * n)
        parts, total = [given], self._none + given
        if self._robots:
            of_scene = scene.tick, scene.x, scene.seen.p, scene.force, scene.torque
            parts.append(self._robots.estimate(*of_scene))
            total = total + parts[-1]
        for estimators in zip(*self._estimators, strict=True):  # of all robots
            parts.append(self._each(estimators, scene, total))
            total = total + parts[-1]
        return parts, total

    def _each(self, estimators: Sequence[Estimator], scene: BatchScene, before: Any) -> Estimates:
        """Of one estimator of each robot; nothing, of a robot whose estimator refuses its scene."""
        found = [self._one.qp.no_error()] * len(estimators)
        for i, estimator in enumerate(estimators):
            with refusing(scene.errors, i):
                found[i] = estimator.estimate(scene[i], before[i])
        return Estimates.of_many(found)

    def _output(self, scene: BatchScene, decided: Decided, total: Estimates, parts: list[Estimates]) -> BatchOutput:
        parameters, values, n = self._one.parameters, decided.values, len(scene.x)
        a, b = values.control_a, values.control_b
        mu_qp, wanted, omega, faults = values.mu, values.u, np.zeros((n, JOINTS)), scene.faults
        for i in (~decided.solved).nonzero()[0].tolist():
            faults.setdefault(i, f"no solver answered: {decided.status[i]}")
            mu_qp[i] = 0.0
            wanted[i] = b[i]
        mu = mu_qp
        if parameters.sigma > 0:
            omega = parameters.sigma * np.array([step.rng.standard_normal(JOINTS) for step in self._steps])
            mu = mu_qp + omega
            wanted = np.array([a[i] @ mu[i] + b[i] for i in range(n)])
        limit = parameters.torque_limit
        torque = wanted.clip(-limit, limit)
        saturated = np.abs(wanted).max(axis=1) > limit + ROUNDING
        if saturated.any():
            mu = mu.copy()
            for i in saturated.nonzero()[0].tolist():
                with refusing(scene.errors, i):
                    mu[i] = np.linalg.solve(a[i], torque[i] - b[i])
        for i in (~np.isfinite(torque.sum(axis=1) + mu.sum(axis=1))).nonzero()[0].tolist():
            faults.setdefault(i, not_finite(wanted[i]))
            saturated[i], torque[i], mu[i], mu_qp[i] = False, 0.0, 0.0, 0.0
        self._torque = torque
        known = (self._robots.shown, [flat(parts[1][i]) for i in range(n)]) if self._robots else ()
        torque = self._by_stance(torque, SWAP_TORQUE)
        self._held = torque.copy()  # which a reset changes, and not what has been handed out
        acted = mu, mu_qp, omega, saturated, list(self.policies)
        return BatchOutput(self._one, scene, torque, decided, total, acted, known)

    def _by_stance(self, values: Array, swapped: Any) -> Array:
        """Columns from left/right to stance/swing order and back."""
        n, columns = values.shape
        if columns not in self._orders:
            order = np.where(self._stance[:, None], swapped, np.arange(columns))
            self._orders[columns] = order + columns * np.arange(n)[:, None]
        return values.ravel()[self._orders[columns]]

    def _refused(self, states: RobotStates) -> dict[int, str]:
        """What `Controller` refuses, by robot."""
        refused, unsure = dict[int, str](), ~(np.isfinite(states.q.sum(axis=1)) & np.isfinite(states.dq.sum(axis=1)))
        now = list(zip(states.previews, states.touchdowns.tolist(), strict=True))
        if self._one.parameters.terrain == "stones":
            unsure |= [seen != checked for seen, checked in zip(now, self._checked, strict=True)]
        for i in unsure.nonzero()[0].tolist():
            with refusing(refused, i):
                self._one._check(states[i])
                self._checked[i] = now[i]
        return refused

    def _swap_legs(self, states: RobotStates, q: Array) -> None:
        """See `Stepping.swaps`."""
        has_come_down = states.contact[np.arange(len(states)), 1 - self._stance]
        for i in has_come_down.nonzero()[0].tolist():
            step = self._steps[i]
            if step.swaps(int(states.tick[i]), states.contact[i], q[i], self._one.parameters):
                self._stance[i], self._torque[i], self._last_tick[i] = step.stance, NO_TORQUE, -2
                self._orders.clear()


PER_ROBOT = {
    *("policies", "_steps", "_estimators", "_answers", "_stance", "_checked", "_torque", "_held", "_path", "_p"),
    *("_last_tick", "_left"),
}
