"""N robots walked by one controller: each gets to the bit the torque that it would get alone. One robot is N = 1.

A tick is `step.py`; here are the rows of numbers that it reads and leaves, the policies, and who solves the QP.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from cbf_clf_qp.answer import INVALID, Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Values
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import DOF, JOINTS, Array, RobotState

from rl_cbf_clf_controller.controller_output import NOTHING, Acted, ControllerOutput, flat
from rl_cbf_clf_controller.policy import LearnedPolicy, Policy, ZeroPolicy
from rl_cbf_clf_controller.residual_policy import Memory, ResidualPolicy
from rl_cbf_clf_controller.scene import ControllerError, Estimator, Scene
from rl_cbf_clf_controller.step import (
    DQ,
    FARTHEST_STONE,
    HIGHEST_STONE,
    NEVER,
    NOT_FINITE,
    UNSOLVED,
    Q,
)
from rl_cbf_clf_controller.step_rows import StepRows

if TYPE_CHECKING:
    from rl_cbf_clf_controller.controller import Controller
    from rl_cbf_clf_controller.parameters import ControllerParameters

NO_NOISE = np.zeros(JOINTS)


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

    `acted`: mu, mu_qp, omega, saturated and the policies; `parts`: the estimates of each estimator.
    """

    one: "Controller"
    scene: BatchScene
    torque: Array
    decided: Decided
    estimates: Estimates
    acted: tuple[Any, ...]
    parts: list[Estimates]
    identified: Array

    def __getitem__(self, i: int) -> ControllerOutput:
        """Of robot `i`."""
        adapted = flat(self.parts[1][i]) if self.identified.size else NOTHING
        parts = self.scene[i], self.act(i), self.decided[i], self.estimates[i]
        return self.one.output_of(*parts, self.identified[i], adapted)

    def act(self, i: int) -> Acted:
        """What acts on robot `i`."""
        mu, mu_qp, omega, saturated, policies = (each[i] for each in self.acted)
        return Acted(self.torque[i], mu, mu_qp, omega, bool(saturated), policies.version, self.scene.faults.get(i, ""))


class BatchController:
    """N robots under copies of one `controller`, each with its policy; several may have the same one.

    One object serves one thread.
    """

    def __init__(self, controller: "Controller", policies: Sequence[Policy]) -> None:
        n, tick = len(policies), controller.qp
        self._one, self.policies, self._n = controller, list(policies), n
        self._estimators = [[each.another() for each in controller.estimators] for _ in policies]
        self._steps = [controller.steps.another() for _ in policies]
        self._solvers = list[Any]([None] * n)  # those outside the function, once they are asked
        self._rngs = [np.random.default_rng(0) for _ in policies]
        self._none = Estimates.of_many([tick.no_error()])
        self._memory = Memory.of(n)
        self.unanswered = 0
        self._bind(controller.first_memory(), n)
        self.set_parameters(controller.parameters)
        for i in range(n):
            self.reset(i, 0)

    def _bind(self, first: Array, n: int) -> None:
        """Arrays of `n` robots."""
        f = self._one.functions
        self._rows = rows = StepRows(f, first, n)
        given = {name: rows.reading[:, place] for name, (place, _) in f.reading.places.items()}
        self._given = {name: given[name] for name in ("q", "dq", "contact", "applied", "stone", "noise")}
        self._force = given["foot_force"].reshape(n, 2, 2)
        columns = {name: f.reading.places[name][0].start for name in ("tick", "touchdowns", "stone_index")}
        self._tick, self._touchdowns, self._stone_index = (rows.reading[:, at] for at in columns.values())
        self._path = f.memory.places

    @property
    def parameters(self) -> "ControllerParameters":
        """They are all robots'."""
        return self._parameters

    @property
    def memory(self) -> Values:
        """A row a robot; it may be written to."""
        return self._one.functions.memory.values(self._rows.memory)

    def set_parameters(self, new: "ControllerParameters", gains: bool = False) -> None:
        """Of all robots; where `gains` change, this tick's V cannot be compared with the last one's."""
        self._parameters = new
        if gains:
            self._rows.memory[:, self._path["last_tick"][0]] = NEVER
        for name, (place, _) in self._one.functions.settings.places.items():
            self._rows.settings[:, place] = getattr(new, name)

    def reset(self, i: int, seed: int) -> None:
        """Begin an episode of robot `i`; see `Controller.reset`."""
        self._rngs[i] = np.random.default_rng(seed)
        self._rows.memory[i] = self._one.first_memory(self._steps[i].first(), self._steps[i])
        self._memory.forget(i)
        for part in (self.policies[i], *self._estimators[i], self._solvers[i]):
            if part:
                part.reset()

    def keep(self, rows: Array) -> None:
        """Go on with some of the robots, by number."""
        memory, settings, reading = self._rows.memory[rows], self._rows.settings[rows], self._rows.reading[rows]
        for name in ("policies", "_estimators", "_steps", "_solvers", "_rngs"):
            setattr(self, name, [getattr(self, name)[i] for i in rows])
        self._memory.keep(rows)
        self._n = len(rows)
        self._bind(memory[0], self._n)
        self._rows.memory[:], self._rows.settings[:], self._rows.reading[:] = memory, settings, reading

    def step(self, states: RobotStates) -> BatchOutput:
        """The torques for one tick; see `Controller.step`. Those of a state that is refused mean nothing."""
        return self.decide(self.look(states))

    def look(self, states: "RobotStates | RobotState", is_kept: bool = True) -> BatchScene:
        """What is seen of the states, after those robots have changed legs that came down.

        Where it is not `is_kept`, no robot changes legs, and the next tick will not know of this one.
        """
        rows, places = self._rows, self._one.functions.memory.places
        self._read(states)
        before, stood = rows.memory.copy(), rows.stand()
        at = self._one.functions.stand.places
        errors = self._errors(states, stood[:, at["refused"][0].start])
        if is_kept:
            for i in (stood[:, at["begins"][0].start] > 0).nonzero()[0].tolist():
                if i not in errors:
                    with refusing(errors, i):
                        self._begin(i, stood[i])
        seen = rows.see().copy()
        if is_kept:
            layout = self._one.functions
            kept = seen[:, layout.scene.places["kept"][0]]
            for name in ("moved", "carries", "stone", "stance", "index", "start", "seconds", "has_begun"):
                rows.memory[:, places[name][0]] = kept[:, layout.kept.places[name][0]]
            rows.memory[:, places["last_tick"][0]] = stood[:, at["last_tick"][0]]
            for name in ("torque", "held"):
                rows.memory[:, places[name][0]] = stood[:, at[name][0]]
            if errors:
                refused = list(errors)
                rows.memory[refused] = before[refused]
        return self._scene(seen, errors)

    def _read(self, states: "RobotStates | RobotState") -> None:
        """Into the rows."""
        given = self._given
        given["q"][...], given["dq"][...], given["contact"][...] = states.q, states.dq, states.contact
        given["applied"][...] = states.applied
        self._force[...], self._tick[...], self._touchdowns[...] = states.foot_force, states.tick, states.touchdowns
        if isinstance(states, RobotState):
            stone = states.preview
            self._stone_index[0] = np.nan if stone is None else stone.index
            given["stone"][0] = (np.nan,) * 3 if stone is None else (stone.l_min, stone.l_max, stone.height)
        else:
            given["stone"][...] = states.stones
            self._stone_index[...] = [np.nan if stone is None else stone.index for stone in states.previews]

    def _begin(self, i: int, stood: Array) -> None:
        """A step of robot `i`."""
        f, memory = self._one.functions, self._rows.memory[i]
        at = f.stand.places
        self._one.begin(self._steps[i], stood[at["x"][0]], stood[at["seconds"][0]].item(), self._previews(i), memory)

    def _previews(self, i: int) -> Any:
        return self._given["stone"][i]

    def _errors(self, states: Any, refused: Array) -> dict[int, str]:
        """What the controller refuses, by robot."""
        if not refused.any():
            return {}
        found = dict[int, str]()
        for i in refused.nonzero()[0].tolist():
            state = states if isinstance(states, RobotState) else states[i]
            found[i] = f"controller error: {why_refused(state, int(refused[i]))}"
        return found

    def _scene(self, rows: Array, errors: dict[int, str]) -> BatchScene:
        f, tick, touchdowns = self._one.functions, self._tick.astype(int), self._touchdowns
        part = {name: rows[:, place] for name, (place, _) in f.scene.places.items()}
        index = part["index"][:, 0].astype(int)
        seen = f.seen.values(part["seen"])
        faults = {
            i: f"contact disagreement: {touchdowns[i]:g} touchdowns, {index[i]} steps"
            for i in (touchdowns != index).nonzero()[0].tolist()
            if i not in errors
        }
        return BatchScene(
            x=part["x"],
            seen=seen,
            force=part["force"].reshape(-1, 2, 2),
            observation=seen.observation[:, : self._one.observed],
            tick=tick,
            torque=part["torque"],
            stance=part["stance"][:, 0].astype(int),
            step_index=index,
            step_time=part["step_time"][:, 0],
            model_error=self._one.model_error,
            errors=errors,
            faults=faults,
        )

    def decide(self, scene: BatchScene, estimates: Estimates | None = None) -> BatchOutput:
        """The torques at these scenes, from all estimators; `estimates` take the place of the policy's."""
        start, rows, f, n = perf_counter(), self._rows, self._one.functions, self._n
        parts, total = self._estimated(scene, estimates)
        for i in range(n) if total.output_error is None else ():
            with refusing(scene.errors, i):
                self._one.check_estimates(total)
        rows.estimates["alpha"][...], rows.estimates["beta"][...] = total.alpha.reshape(n, -1), total.beta
        rows.estimates["output_error"][...] = 0 if total.output_error is None else total.output_error.reshape(n, -1)
        omega = np.zeros((n, JOINTS))
        if self._parameters.sigma > 0:
            omega = self._parameters.sigma * np.array([rng.standard_normal(JOINTS) for rng in self._rngs])
        self._given["noise"][...] = omega
        row, solver, status = self._solved()
        acted = {name: row[:, place] for name, (place, _) in f.acted.places.items()}
        known = np.ones(n, dtype=bool)
        known[list(scene.errors)] = False
        rows.memory[known] = acted["memory"][known]
        is_solved = acted["solved"][:, 0] > 0
        decided = Decided(
            f.read.values(acted["answer"]), self._one.qp.layout, is_solved, solver, status, (perf_counter() - start) / n
        )
        for i in acted["fault"][:, 0].nonzero()[0].tolist():
            kind = int(acted["fault"][i, 0])
            if kind == UNSOLVED:
                scene.faults.setdefault(i, f"no solver answered: {status[i]}")
            elif kind == NOT_FINITE:
                scene.faults.setdefault(i, f"torque not finite: {acted['wanted'][i].tolist()} N m")
        did = acted["mu"], acted["mu_qp"], omega, acted["saturated"][:, 0] > 0, list(self.policies)
        identified = rows.see.row[:, f.scene.places["identified"][0]].copy() if f.identifies else np.zeros((n, 0))
        return BatchOutput(self._one, scene, acted["command"], decided, total, did, parts, identified)

    def _solved(self) -> tuple[Array, list[str], list[str]]:
        """What was decided, (N, size), by the first solver; by its guard where that has no answer."""
        n, at = self._n, self._one.functions.acted.places
        solver, status, names = [""] * n, [""] * n, self._one.solvers
        row, left = np.zeros((n, self._one.functions.acted.size)), np.arange(n)
        for name in names:
            found = self._rows.decide() if name == "daqp" else self._by_solvers(name, left, status)
            row[left] = found[left]
            answer = row[:, at["answer"][0]]
            solved, valid = row[:, at["solved"][0].start] > 0, answer[:, self._one.is_valid] > 0
            for i in left.tolist():
                solver[i] = name
                if name == "daqp":
                    status[i] = "solved" if solved[i] else "not solved" if valid[i] else INVALID
            left = (~solved).nonzero()[0]
            if name == names[0]:
                self.unanswered += len(left)
            left = left[valid[left]]
            if not left.size:
                break
        return row, solver, status

    def _by_solvers(self, name: str, robots: Array, status: list[str]) -> Array:
        """By a solver outside the function, one robot after the other."""
        rows, data = self._rows, self._rows.data()
        for i in robots.tolist():
            if self._solvers[i] is None:
                self._solvers[i] = self._one.make_solver(name)
            answer = self._solvers[i].solve(self._one.functions.programme.values(data[i]))
            rows.x[i], rows.y[i], rows.tolerance[i], status[i] = answer
        return rows.finish()

    def _estimated(self, scene: BatchScene, given: Estimates | None) -> tuple[list[Estimates], Estimates]:
        """Of the policy, then of each other estimator; and in all."""
        policy, n, f = self.policies[0], self._n, self._one.functions
        if policy.comes_last or (given is None and isinstance(policy, ZeroPolicy)):
            q, m = self._none.alpha.shape[-2:]
            given = Estimates(np.zeros((n, q, m)), np.zeros((n, q)), np.zeros((n, m, m + 1)))
        elif given is None and isinstance(policy, LearnedPolicy) and len(set(map(id, self.policies))) == 1:
            given = policy.act_of_many(scene.observation, scene.seen.LgV)
        elif given is None:
            given = self._each(self.policies, scene, [self._one.qp.no_error()] * n)
        parts, total = [given], self._none + given
        if f.identifies:
            row, places = self._rows.see.row, f.scene.places
            found = [row[:, places[f"identified_{name}"][0]].copy() for name in ("alpha", "beta", "output_error")]
            parts.append(Estimates(found[0].reshape(total.alpha.shape), found[1], found[2].reshape(n, JOINTS, -1)))
            total = total + parts[-1]
        for estimators in zip(*self._estimators, strict=True):  # of all robots
            parts.append(self._each(estimators, scene, total))
            total = total + parts[-1]
        if isinstance(policy, ResidualPolicy):
            parts[0] = policy.of_many(self._memory, scene, total)
            total = total + parts[0]
        return parts, total

    def _each(self, estimators: Sequence[Estimator], scene: BatchScene, before: Any) -> Estimates:
        """Of one estimator of each robot; nothing, of a robot whose estimator refuses its scene."""
        found = [self._one.qp.no_error()] * len(estimators)
        for i, estimator in enumerate(estimators):
            with refusing(scene.errors, i):
                found[i] = estimator.estimate(scene[i], before[i])
        return Estimates.of_many(found)


def why_refused(state: RobotState, kind: int) -> str:
    """In words."""
    if kind in (Q, DQ):
        name = "q" if kind == Q else "dq"
        return f"state.{name} = {getattr(state, name)}: expected {DOF} finite values"
    stone = state.preview
    if stone is None or stone.index != state.touchdowns + 1:
        return f"state.preview = {stone}: expected stone {state.touchdowns + 1}"
    if not 0 < stone.l_min < stone.l_max < FARTHEST_STONE:
        return f"state.preview = {stone}: expected 0 < l_min < l_max < {FARTHEST_STONE:g} m"
    return f"state.preview = {stone}: expected a height of at most {HIGHEST_STONE:g} m"
