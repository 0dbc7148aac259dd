"""The controller's tick of N robots at once: the functions of `controller.py`, mapped; each robot's torque is to the
bit what a `Controller` of its own would give.

State, outputs, rows, QP, policy and torque are computed for all robots together. What happens once a step, and an
estimator that learns within the walk or knows its plant (the identified robot, L1, an oracle), goes robot by robot.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from cbf_clf_qp.answer import Decided, answers
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Values, places_of
from cbf_clf_qp.qp import ROUNDING as ACTIVE
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import SWAP_STATE, SWAP_TORQUE, TICK_SECONDS, Array, Leg

from rl_cbf_clf_controller.controller import NO_BARRIERS, NO_TORQUE, ROUNDING, SECONDS, Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.identified_robot import IdentifiedRobot
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import LearnedPolicy, Policy
from rl_cbf_clf_controller.scene import ControllerError, Scene
from rl_cbf_clf_controller.step_outputs import Touchdown
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints

GLANCE = ("eta", "V", "LgV", "phase", "observation", "B1_state", "B2_state")  # what policy and figures read of a state


@dataclass(frozen=True)
class BatchScene:
    """What is seen of N robots, a row each; see `Scene`, and `ControllerOutput` for the others.

    `details`: of them `nominal_a`, `nominal_b`, `measured`, `mu_held`, where they are asked for. `errors`: why the
    controller refuses a robot's state, `faults`: why its episode must end, both by its number.
    """

    tick: Array
    x: Array
    p: Array
    seen: Values
    force: Array
    observation: Array
    torque: Array
    stance: Array
    step_index: Array
    step_time: Array
    details: dict[str, Array]
    errors: dict[int, str]
    faults: dict[int, str]

    def fields(self, i: int) -> dict[str, Any]:
        """What a `ControllerOutput` of robot `i` has of it."""
        seen, barriers = self.seen, [NO_BARRIERS, NO_BARRIERS]
        if hasattr(seen, "B1_state"):
            barriers = [np.array([seen.B1_state[i, order], seen.B2_state[i, order]]) for order in (0, 1)]
        return {
            "tick": int(self.tick[i]),
            "stance": Leg(int(self.stance[i])),
            "step_index": int(self.step_index[i]),
            "step_time": float(self.step_time[i]),
            "phase": float(seen.phase[i, 0]),
            "eta": seen.eta[i].copy(),
            "V": float(seen.V[i, 0]),
            "barriers": barriers[0],
            "barrier_rates": barriers[1],
            "observation": self.observation[i].copy(),
            "LgV": seen.LgV[i].copy(),
            **{name: values[i] for name, values in self.details.items()},
        }


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
    policies: list[Policy]
    parameters: ControllerParameters
    own: dict[str, Sequence[Any]]

    def __getitem__(self, i: int) -> ControllerOutput:
        """Of robot `i`; without details `nominal_a`, `nominal_b`, `measured` and `mu_held` are empty."""
        decided, layout = self.decided, self.decided.layout
        slack, margin = decided.values.slack[i], decided.values.margin[i].tolist()
        gives = slack.any()
        return ControllerOutput(
            torque=self.torque[i],
            mu=self.mu[i],
            mu_qp=self.mu_qp[i],
            omega=self.omega[i],
            alpha=self.estimates.alpha[i],
            beta=self.estimates.beta[i],
            clf_slack=float(slack @ ~layout.rescues) if gives else 0.0,
            rescue_slack=float(slack @ layout.rescues) if gives else 0.0,
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
            **self.scene.fields(i),
            **{name: values[i] for name, values in self.own.items()},
        )


class BatchController:
    """N robots under copies of one `controller`, each with its policy; several may have the same one.

    `details`: whether an output has all that a transition is made of. One object serves one thread.
    """

    def __init__(self, controller: Controller, policies: Sequence[Policy], details: bool = False) -> None:
        n, tick = len(policies), controller.qp
        self._one, self._details, self.policies = controller, details, list(policies)
        self.parameters = controller.parameters
        self._steps = [controller.steps.another() for _ in policies]
        self._estimators = [[each.another() for each in controller._estimators] for _ in policies]
        firsts = [estimators[0] for estimators in self._estimators if estimators]
        self._robots = [first for first in firsts if isinstance(first, IdentifiedRobot)]
        self._acts_at_once = isinstance(policies[0], LearnedPolicy) and len(set(map(id, policies))) == 1
        self._needs_scenes = not self._acts_at_once or bool(controller._estimators)
        names = [name for name in GLANCE if name in tick.reads]
        self._read = tick.look if details or self._needs_scenes else tick.glance(names)
        self._phase, self._desired = controller.steps.first().functions
        self._answers = [tick.answer.another() for _ in policies]
        self._places = {name: place for name, (place, _) in places_of(tick.system.named).items()}
        self._stones = slice(self._places["l_min"].start, self._places["height"].stop)
        self._rngs = [np.random.default_rng(0) for _ in policies]
        self._constraints = [steps.first() for steps in self._steps]
        self._stance, self._index, self._start_tick = np.zeros((3, n), dtype=int)
        self._orders: dict[int, Array] = {}  # of the columns, by their number, for the legs that stand
        self._checked = np.full((n, 3), np.nan)  # stones
        self._has_begun, self._seconds_before = np.zeros(n, dtype=bool), np.zeros(n)
        self._torque = np.tile(NO_TORQUE, (n, 1))
        self._path, self._scale = (
            np.array([getattr(each, of) for each in self._constraints]) for of in ("row", "scale")
        )
        self._p = np.tile(controller._p, (n, 1))
        self._last_tick, self._last_x, self._last_p = np.full(n, -2), np.zeros((n, 14)), self._p.copy()
        self._none = Estimates.of_many([tick.no_error()])
        self._no_output_error = tick.terms.inputs, tick.terms.inputs + 1

    def reset(self, i: int, seed: int) -> None:
        """Begin an episode of robot `i`; see `Controller.reset`."""
        self._rngs[i] = np.random.default_rng(seed)
        self._stance[i] = self._index[i] = self._start_tick[i] = 0
        self._orders.clear()
        self._seconds_before[i], self._torque[i], self._last_tick[i] = np.nan, NO_TORQUE, -2
        self._has_begun[i] = False
        self._follow(i, self._steps[i].first())
        self._answers[i].reset()
        for estimator in (self.policies[i], *self._estimators[i]):
            estimator.reset()

    def keep(self, rows: Array) -> None:
        """Go on with some of the robots, by number."""
        for name, value in vars(self).items():
            if name in PER_ROBOT:
                setattr(self, name, value[rows] if isinstance(value, np.ndarray) else [value[i] for i in rows])
        self._robots = self._robots and [self._robots[i] for i in rows]
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
            self._torque = np.where(is_known[:, None], self._by_stance(states.applied, SWAP_TORQUE), self._torque)
        if self._robots:
            q = np.array([robot.set_right(each) for robot, each in zip(self._robots, q, strict=True)])
        faults = self._swap_legs(states, q)
        x = np.concatenate([self._by_stance(q, SWAP_STATE), self._by_stance(dq, SWAP_STATE)], axis=1)
        for i in (~self._has_begun).nonzero()[0].tolist():
            self._begin_step(i, x[i], states)
        if self._robots and self._one.parameters.prediction:
            pairs = zip(self._robots, x, self._torque, strict=True)
            x = np.array([robot.predicted(each, torque) for robot, each, torque in pairs])
        p = self._p = self._p.copy()
        phase = self._phase.of_many(x[:, :7], self._scale)
        desired = self._desired.of_many(phase.row, self._path)
        for name in self._desired.places:
            p[:, self._places[name]] = getattr(desired, name)
        p[:, self._places["phase_scale"]] = self._scale
        force = self._by_stance(states.foot_force.reshape(-1, 4), SWAP_TORQUE).reshape(-1, 2, 2)
        p[:, self._places["force"]] = force[:, 0]
        sees_stone = ~np.isnan(states.stones[:, :1])
        p[:, self._stones] = np.where(sees_stone, states.stones, p[:, self._stones])
        seen = self._read.of_many(x, p)
        stone = next((each for each in states.previews if each), None)
        observed = self._one._terrain.observed(stone, self._steps[0].wanted)
        return BatchScene(
            tick=states.tick,
            x=x,
            p=p,
            seen=seen,
            force=force,
            observation=seen.observation[:, :observed],
            torque=self._torque.copy(),
            stance=self._stance.copy(),
            step_index=self._index.copy(),
            step_time=(states.tick - self._start_tick) * TICK_SECONDS,
            details=self._detailed(states.tick, x, p, seen) if self._details else {},
            errors=errors,
            faults=faults,
        )

    def decide(self, scene: BatchScene, estimates: Estimates | None = None) -> BatchOutput:
        """The torques at these scenes, from all estimators; `estimates` take the place of the policy's."""
        parts = self._estimated(scene, estimates)
        total = sum(parts[1:], start=self._none + parts[0])
        error = total.output_error
        if error is None:
            if self._one.parameters.objective == "pd_centred" and not self._one._corrects_input:
                raise ControllerError(
                    "objective pd_centred: expected a structured policy, which gives the output error"
                )
            error = np.zeros((len(scene.x), *self._no_output_error))
        decided = answers(self._answers, scene.x, scene.p, total.alpha, total.beta, error)
        output = self._output(scene, decided, total, parts)
        self._last_tick, self._last_x, self._last_p = scene.tick, scene.x, scene.p
        return output

    def _estimated(self, scene: BatchScene, given: Estimates | None) -> list[Estimates]:
        """Of the policy, then of each other estimator."""
        policy = self.policies[0]
        if given is None and self._acts_at_once and isinstance(policy, LearnedPolicy):
            given = policy.act_of_many(scene.observation, scene.seen.LgV)
        if given is not None and not self._one._estimators:
            return [given]
        found = []
        for i in range(len(scene.x)):
            one = self._scene(scene, i)
            parts = [self.policies[i].estimate(one, self._one.qp.no_error()) if given is None else given[i]]
            total = self._one.qp.no_error() + parts[0]
            for estimator in self._estimators[i]:
                parts.append(estimator.estimate(one, total))
                total = total + parts[-1]
            found.append(parts)
        return [Estimates.of_many(part) for part in zip(*found, strict=True)]

    def _scene(self, s: BatchScene, i: int) -> Scene:
        """As an estimator of robot `i` sees it."""
        tick, stance, error = int(s.tick[i]), int(s.stance[i]), self._one._error
        return Scene(s.x[i], s.p[i], s.seen.of(i), s.force[i], s.observation[i], tick, s.torque[i], stance, error)

    def _output(self, scene: BatchScene, decided: Decided, total: Estimates, parts: list[Estimates]) -> BatchOutput:
        parameters, values, n = self._one.parameters, decided.values, len(scene.x)
        a, b = values.control_a, values.control_b
        mu_qp, wanted, omega, faults = values.mu, values.u, np.zeros((n, 4)), scene.faults
        for i in (~decided.solved).nonzero()[0].tolist():
            faults.setdefault(i, f"no solver answered: {decided.status[i]}")
            mu_qp[i] = 0.0
            wanted[i] = a[i] @ mu_qp[i] + b[i]
        mu = mu_qp
        if parameters.sigma > 0:
            omega = parameters.sigma * np.array([rng.standard_normal(4) for rng in self._rngs])
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
        own: dict[str, Sequence[Any]] = {}
        if self._robots and self._details:
            own |= {
                "identified": [robot.known for robot in self._robots],
                "adapted": [parts[1][i].flat for i in range(n)],
            }
        torque = self._by_stance(torque, SWAP_TORQUE)
        names, policies = self._one.qp.names, list(self.policies)
        return BatchOutput(scene, torque, decided, total, mu, mu_qp, omega, saturated, names, policies, parameters, own)

    def _detailed(self, tick: Array, x: Array, p: Array, seen: Values) -> dict[str, Array]:
        measured = self._one._measure.of_many(self._last_x, self._last_p, x, p, SECONDS).measured
        measured[self._last_tick != tick - 1] = np.nan
        pairs = zip(seen.outputs_a, self._torque, seen.outputs_b, strict=True)
        found = {"nominal_a": seen.nominal_a, "nominal_b": seen.nominal_b, "measured": measured}
        return {**found, "mu_held": np.array([a @ torque + b for a, torque, b in pairs])}

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

    def _begin_step(self, i: int, x: Array, states: RobotStates) -> None:
        """See `Controller`."""
        seconds = None if np.isnan(self._seconds_before[i]) else float(self._seconds_before[i])
        taken = -float(self._one._feet(x[:7]).swing[0])
        self._follow(i, self._steps[i].begin(Touchdown(x[:7], x[7:], taken, seconds, states.previews[i])))
        self._has_begun[i] = True

    def _follow(self, i: int, constraints: VirtualConstraints) -> None:
        """From now on robot `i` has these outputs."""
        self._constraints[i] = constraints
        self._path[i], self._scale[i] = constraints.row, constraints.scale
        lengths = self._steps[i].wanted
        self._p[i, self._places["step_length"]] = lengths[0] if lengths else 0.0


PER_ROBOT = {
    *(
        "policies",
        "_answers",
        "_steps",
        "_estimators",
        "_rngs",
        "_constraints",
        "_stance",
        "_index",
        "_start_tick",
        "_has_begun",
    ),
    *("_seconds_before", "_checked", "_torque", "_path", "_scale", "_p", "_last_tick", "_last_x", "_last_p"),
}
