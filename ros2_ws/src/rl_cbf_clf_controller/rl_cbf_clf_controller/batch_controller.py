"""N robots walked by one controller: a robot gets to the bit the torque that it would get alone. One robot is N = 1.

A tick is `step.py`; here are the rows of numbers that it reads and leaves, the policies, and who solves the QP.
"""

from collections.abc import Sequence
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from cbf_clf_qp.answer import INVALID
from cbf_clf_qp.batch_functions import Bound
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Values
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import DOF, Array, RobotState, StonePreview

from rl_cbf_clf_controller.batch_output import BatchOutput, BatchScene, estimates_of, identified, refusing, scene_of
from rl_cbf_clf_controller.controller_parts import ControllerParts
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy, Policy, ZeroPolicy
from rl_cbf_clf_controller.rabbit_step import FARTHEST_STONE, HIGHEST_STONE, NEVER
from rl_cbf_clf_controller.residual_policy import Memory, ResidualPolicy
from rl_cbf_clf_controller.step import DQ, Q, StepFunctions

if TYPE_CHECKING:
    from rl_cbf_clf_controller.parameters import ControllerParameters

NO_STONE = StonePreview(0, np.nan, np.nan, np.nan)


class BatchController:
    """N robots under copies of one `controller`, each with its policy; several may have the same one.

    One object serves one thread.
    """

    def __init__(self, controller: ControllerParts, policies: Sequence[Policy]) -> None:
        n = len(policies)
        self._one, self.policies, self._n = controller, list(policies), n
        self._solvers = list[Any]([None] * n)  # those outside the function, once they are asked
        self._rngs = list[Any]([None] * n)
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
        self._reading = {name: rows.reading[:, place] for name, (place, _) in f.reading.places.items()}
        self._tick, self._touchdowns = (self._reading[name][:, 0] for name in ("tick", "touchdowns"))
        self._previews = list[Any]([()] * n)  # whose numbers are in the rows
        self._is_sound, self._to_memory = self._one.places["is_sound"].start, self._one.places["memory"]
        self._silence, self._is_silent = np.zeros((n, f.reading.sizes["noise"])), True
        self._nothing, self._to_adapted = np.zeros((n, f.estimates.size)), self._one.places.get("adapted")
        self._path = f.memory.places

    @property
    def parameters(self) -> "ControllerParameters":
        """The parameters of all robots."""
        return self._parameters

    @property
    def settings(self) -> Values:
        """A row a robot; it may be written to."""
        return self._one.functions.settings.values(self._rows.settings)

    @property
    def memory(self) -> Values:
        """A row a robot; it may be written to."""
        return self._one.functions.memory.values(self._rows.memory)

    def set_parameters(self, new: "ControllerParameters", gains: bool = False) -> None:
        """Sets them for all robots; where `gains` change, this tick's V cannot be compared with the last one's."""
        self._parameters = new
        if gains:
            self._rows.memory[:, self._path["last_tick"][0]] = NEVER
        for name, (place, _) in self._one.functions.settings.places.items():
            if hasattr(new, name):  # the others are set by hand
                self._rows.settings[:, place] = getattr(new, name)

    def reset(self, i: int, seed: int) -> None:
        """Begin an episode of robot `i`; see `Controller.reset`."""
        self._rngs[i] = np.random.default_rng(seed)
        self._rows.memory[i] = self._one.first_memory()
        self._memory.forget(i)
        for part in (self.policies[i], self._solvers[i]):
            if part:
                part.reset()

    def keep(self, rows: Array) -> None:
        """Go on with some of the robots, by number."""
        memory, settings, reading = self._rows.memory[rows], self._rows.settings[rows], self._rows.reading[rows]
        for name in ("policies", "_solvers", "_rngs"):
            setattr(self, name, [getattr(self, name)[i] for i in rows])
        self._memory.keep(rows)
        self._n = len(rows)
        self._bind(memory[0], self._n)
        self._rows.memory[:], self._rows.settings[:], self._rows.reading[:] = memory, settings, reading
        self._is_silent = False  # there is the last tick's noise

    def step(self, states: "RobotStates | RobotState | Sequence[RobotState]") -> BatchOutput:
        """The torques for one tick; see `Controller.step`. Those of a state that is refused mean nothing."""
        policy = self.only_policy()
        if policy is None:
            return self.decide(self.look(states))
        start, rows, n = perf_counter(), self._rows, self._n
        self._read(states)
        omega, is_sound, solver, status = self._noise(), False, ["daqp"] * n, ["solved"] * n
        learned = self._nothing
        if type(policy) is ZeroPolicy and self._one.solvers[0] == "daqp":
            report = rows.step().copy()
            is_sound = 0.0 not in report[:, self._is_sound].tolist()
        if not is_sound:
            learned = self._learned(policy, rows.look())
            rows.estimates[...] = self._total(learned, rows.look.row)
            acted, solver, status = self._solved()
            report = np.concatenate([rows.look.row, acted], axis=1)
            is_sound = 0.0 not in report[:, self._is_sound].tolist()
        errors = {} if is_sound else self._errors(states, report[:, self._one.places["refused"]][:, 0])
        memory = report[:, self._to_memory]
        if errors:
            known = [i for i in range(n) if i not in errors]
            rows.memory[known] = memory[known]
        else:
            rows.memory[...] = memory
        answered = solver, status, (perf_counter() - start) / n
        total = self._total(learned, report)
        return BatchOutput(self._one, report, self.policies[:], omega, answered, errors, is_sound, total, learned)

    def only_policy(self) -> ZeroPolicy | ActorPolicy | None:
        """That of all robots, where it needs nothing but the observation and always gives an output error."""
        policy = self.policies[0]
        if type(policy) is ZeroPolicy or (type(policy) is ActorPolicy and policy.is_structured):
            return policy if self.policies == [policy] * self._n else None
        return None

    def _learned(self, policy: ZeroPolicy | ActorPolicy, seen: Array) -> Array:
        """The policy's estimates, (N, size)."""
        if isinstance(policy, ActorPolicy):
            observation, LgV = self._one.learned_from
            return policy.values_of_many(seen[:, observation], seen[:, LgV]).row
        return self._nothing

    def _total(self, learned: Array, seen: Array) -> Array:
        """The learned estimates with those of the identified robots, (N, size)."""
        if self._to_adapted is None:
            return learned
        adapted = seen[:, self._to_adapted]
        return adapted if learned is self._nothing else learned + adapted

    def _take(self, total: Estimates) -> Array:
        """A copy of them, (N, size), which are in the rows now."""
        for (place, _), values in zip(self._one.functions.estimates.places.values(), vars(total).values(), strict=True):
            self._rows.estimates[:, place] = 0 if values is None else values.reshape(self._n, -1)
        return self._rows.estimates.copy()

    def _noise(self) -> Array:
        """The noise to explore with, (N, m)."""
        sigma = self._parameters.sigma
        if sigma == 0 and self._is_silent:
            return self._silence
        omega = sigma * self._drawn()
        self._reading["noise"][...], self._is_silent = omega, sigma == 0
        return omega

    def _drawn(self) -> Array:
        """Standard normal numbers for each robot, (N, m)."""
        none, explores = self._silence[0], self._parameters.sigma > 0
        return np.array([rng.standard_normal(none.size) if explores else none for rng in self._rngs])

    def look(self, states: Any) -> BatchScene:
        """What is seen of the states, after those robots have changed legs that came down.

        The next tick knows of it if `decide` or `go_on` follows.
        """
        self._read(states)
        self._seen = seen = self._rows.look().copy()
        return scene_of(self._one, seen, self._errors(states, seen[:, self._one.places["refused"]][:, 0]))

    def go_on(self) -> None:
        """Goes on to the next tick from what was looked at last, without a decision."""
        f = self._one.functions
        kept = self._seen[:, f.scene.places["kept"][0]]
        for name, (place, _) in f.kept.places.items():
            self._rows.memory[:, f.memory.places[name][0]] = kept[:, place]

    def identified(self) -> Estimates:
        """The estimates of the identified robots, of the states that were looked at last."""
        return sum(identified(self._one, self._seen), estimates_of(self._one, self._nothing))

    def reading(self, states: Any) -> Array:
        """The states as the function reads them, without noise, (N, size)."""
        self._read(states)
        return self._rows.reading.copy()

    def _read(self, states: Any) -> None:
        """Into the rows."""
        row = self._reading
        row["q"][...], row["dq"][...], row["contact"][...] = states.q, states.dq, states.contact
        row["applied"][...], row["foot_force"][...] = states.applied, states.foot_force.reshape(self._n, -1)
        self._tick[...], self._touchdowns[...] = states.tick, states.touchdowns
        for i, stone in enumerate([states.preview] if isinstance(states, RobotState) else states.previews):
            if stone is not self._previews[i]:
                self._previews[i] = stone
                seen = stone or NO_STONE
                row["stone"][i] = seen.index, seen.l_min, seen.l_max, seen.height

    def _errors(self, states: Any, refused: Array) -> dict[int, str]:
        """What the controller refuses, by robot."""
        if not refused.any():
            return {}
        errors = dict[int, str]()
        for i in refused.nonzero()[0].tolist():
            state = states if isinstance(states, RobotState) else states[i]
            errors[i] = f"controller error: {self._why_refused(state, int(refused[i]))}"
        return errors

    def decide(self, scene: BatchScene, estimates: Estimates | None = None) -> BatchOutput:
        """The torques at these scenes, from all estimators; `estimates` take the place of the policy's."""
        start, rows, f, n = perf_counter(), self._rows, self._one.functions, self._n
        parts, total = self._estimated(scene, estimates)
        for i in range(n) if total.output_error is None else ():
            with refusing(scene.errors, i):
                self._one.check_estimates(total)
        row = self._take(total)
        omega = self._noise()
        acted, solver, status = self._solved()
        known = [i for i in range(n) if i not in scene.errors]
        rows.memory[known] = acted[known, f.acted.places["memory"][0]]
        answered = solver, status, (perf_counter() - start) / n
        report = np.concatenate([self._seen, acted], axis=1)
        output = BatchOutput(self._one, report, self.policies[:], omega, answered, scene.errors, False, row, row, parts)
        scene.faults |= output.faults
        return output

    def _solved(self) -> tuple[Array, list[str], list[str]]:
        """What was decided, (N, size), by the first solver; by its guard where that has no answer."""
        n, at = self._n, self._one.functions.acted.places
        solver, status, names = [""] * n, [""] * n, self._one.solvers
        if names[0] == "daqp" and 0.0 not in self._rows.decide()[:, at["solved"][0].start].tolist():
            return self._rows.decide.row, ["daqp"] * n, ["solved"] * n
        row, left = np.zeros((n, self._one.functions.acted.size)), np.arange(n)
        for name in names:
            decided = self._rows.decide() if name == "daqp" else self._by_solvers(name, left, status)
            row[left] = decided[left]
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
        """Solves by a solver outside the function, one robot after the other."""
        rows, data = self._rows, self._rows.data()
        for i in robots.tolist():
            if self._solvers[i] is None:
                self._solvers[i] = self._one.make_solver(name)
            answer = self._solvers[i].solve(self._one.functions.programme.values(data[i]))
            rows.x[i], rows.y[i], rows.tolerance[i], status[i] = answer
        return rows.finish()

    def _estimated(self, scene: BatchScene, learned: Estimates | None) -> tuple[list[Estimates], Estimates]:
        """The estimates of the policies, by default as they say, and of the identified robot; and their sum."""
        policy, is_shared = self.policies[0], len(set(map(id, self.policies))) == 1
        adapted = identified(self._one, self._seen)
        before = sum(adapted, estimates_of(self._one, self._nothing))
        if learned is None and is_shared and isinstance(policy, LearnedPolicy):
            learned = policy.act_of_many(scene.observation, scene.seen.LgV)
        elif learned is None and is_shared and isinstance(policy, ResidualPolicy):
            learned = policy.of_many(self._memory, scene, before)
        elif learned is None:
            learned = self._asked(scene, before)
        return [learned, *adapted], before + learned

    def _asked(self, scene: BatchScene, before: Estimates) -> Estimates:
        """The estimates of each robot's policy; nothing where a policy refuses its scene."""
        estimates = [self._one.qp.no_error()] * self._n
        for i, policy in enumerate(self.policies):
            with refusing(scene.errors, i):
                estimates[i] = policy.estimate(scene[i], before[i])
        return Estimates.of_many(estimates)

    def _why_refused(self, state: RobotState, kind: int) -> str:
        """Why a state is refused, in words."""
        if kind in (Q, DQ):
            name = "q" if kind == Q else "dq"
            return f"state.{name} = {getattr(state, name)}: expected {DOF} finite values"
        stone = state.preview
        if stone is None or stone.index != state.touchdowns + 1:
            return f"state.preview = {stone}: expected stone {state.touchdowns + 1}"
        if not 0 < stone.l_min < stone.l_max < FARTHEST_STONE:
            return f"state.preview = {stone}: expected 0 < l_min < l_max < {FARTHEST_STONE:g} m"
        return f"state.preview = {stone}: expected a height of at most {HIGHEST_STONE:g} m"


class StepRows:
    """Memory, readings and reports of `n` robots, a row for each; see `step.py`. One object serves one thread."""

    def __init__(self, f: StepFunctions, first: Array, n: int) -> None:
        self.memory, self.reading = np.tile(first, (n, 1)), np.zeros((n, f.reading.size))
        self.settings, gaits = np.zeros((n, f.settings.size)), np.tile(f.gaits, (n, 1))
        arrays = self.memory, self.reading, self.settings
        self.look = Bound(f.look, *arrays, gaits)
        self.step = Bound(f.step, *arrays, gaits)
        self.estimates = np.zeros((n, f.estimates.size))
        self.decide = Bound(f.decide, self.reading, self.settings, self.look.row, self.estimates)
        self.data = Bound(f.data, self.look.row, self.estimates)
        self.x, self.y, self.tolerance = (np.zeros((n, f.finish.function.numel_in(i))) for i in ("x", "y", "tolerance"))
        answer = self.data.row, self.x, self.y, self.tolerance
        self.finish = Bound(f.finish, self.reading, self.settings, self.look.row, *answer)
