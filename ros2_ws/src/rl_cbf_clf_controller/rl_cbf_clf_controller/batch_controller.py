"""N robots walked by one controller: each gets to the bit the torque that it would get alone. One robot is N = 1.

A tick is `step.py`; here are the rows of numbers that it reads and leaves, the policies, and who solves the QP.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from cbf_clf_qp.answer import INVALID, Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Values
from cbf_clf_qp.qp import ROUNDING as AT_BOUND
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import DOF, JOINTS, Array, Leg, RobotState, StonePreview

from rl_cbf_clf_controller.controller_output import Acted, ControllerOutput
from rl_cbf_clf_controller.controller_parts import ControllerParts
from rl_cbf_clf_controller.policy import LearnedPolicy, Policy, ZeroPolicy
from rl_cbf_clf_controller.residual_policy import Memory, ResidualPolicy
from rl_cbf_clf_controller.scene import ControllerError, Estimator, Scene
from rl_cbf_clf_controller.step import (
    DISAGREEMENT,
    DQ,
    FARTHEST_STONE,
    HIGHEST_STONE,
    NEVER,
    UNSOLVED,
    Q,
)
from rl_cbf_clf_controller.step_rows import StepRows

if TYPE_CHECKING:
    from rl_cbf_clf_controller.parameters import ControllerParameters

NO_NOISE = np.zeros(JOINTS)
NO_STONE = astuple(StonePreview(0, np.nan, np.nan, np.nan))
LEGS = tuple(Leg)
BEGUN = (
    "stance",
    "index",
    "start",
    "seconds",
    "has_begun",
    "path",
    "phase_scale",
    "steps",
    "place",
    "moved",
    "carries",
)


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


class BatchOutput:
    """What a tick decides, a row a robot; see `ControllerOutput`. `torque` (N, 4): left/right order, saturated, N m.

    `errors`: why the controller refuses a robot's state, `faults`: why its episode must end, both by its number;
    `omega` (N, 4): the noise; `parts`: the estimates of each estimator, None: those of the identified robot, if any.
    """

    def __init__(
        self,
        one: ControllerParts,
        report: Array,
        policies: list[Policy],
        omega: Array,
        answered: tuple[list[str], list[str], float],
        errors: dict[int, str],
        is_sound: bool,
        parts: list[Estimates] | None = None,
    ) -> None:
        self._one, self._report, self._policies, self.omega = one, report, policies, omega
        self._answered, self.errors, self._parts = answered, errors, parts
        self.torque = report[:, one.places["command"]]
        self.faults = {} if is_sound else self._faults()

    def __getitem__(self, i: int) -> ControllerOutput:
        """Of robot `i`."""
        one, row = self._one, self._report[i]
        at, parameters = one.output_places, one.parameters
        arrays = {name: row[place] for name, place in at.arrays.items()}
        if self._parts is None and one.functions.identifies:
            arrays |= {name: row[place] for name, place in at.identified.items()}
            arrays["alpha"] = arrays["alpha"].reshape(at.alpha)
        else:
            of_all = self.estimates
            arrays |= {"alpha": of_all.alpha[i], "beta": of_all.beta[i]}
            if one.functions.identifies:
                arrays |= {name: row[at.identified[name]] for name in ("identified", "adapted")}
        arrays["nominal_a"] = arrays["nominal_a"].reshape(at.alpha)
        solver, status, seconds = self._answered
        layout, margins = one.qp.layout, row[at.margin].tolist()
        tick, index, stance, step_time, phase, V, solved, clf_slack, rescue_slack = row[at.scalars].tolist()
        return ControllerOutput(
            **arrays,
            **vars(self.act(i)),
            tick=int(tick),
            stance=LEGS[int(stance)],
            step_index=int(index),
            step_time=step_time,
            phase=phase,
            V=V,
            barrier_names=one.barrier_names,
            quantities=one.qp.names,
            clf_slack=clf_slack,
            rescue_slack=rescue_slack,
            active=tuple(name for name, margin in zip(layout.names, margins, strict=True) if margin < AT_BOUND),
            rows=layout.names,
            solver=solver[i],
            status=status[i],
            answered=solved > 0 and solver[i] == parameters.qp_solver,
            solve_seconds=seconds,
            objective=parameters.objective,
            adaptation=parameters.adaptation,
        )

    def act(self, i: int) -> Acted:
        """What acts on robot `i`."""
        row, at = self._report[i], self._one.acted_at
        mu, mu_qp, saturated = row[at[0]], row[at[1]], row.item(at[2]) > 0
        fault = self.faults.get(i, "")
        return Acted(self.torque[i], mu, mu_qp, self.omega[i], saturated, self._policies[i].version, fault)

    @cached_property
    def scene(self) -> BatchScene:
        """What was seen."""
        return scene_of(self._one, self._report, self.errors)

    @cached_property
    def decided(self) -> Decided:
        """The answers to the QPs."""
        answer, solved = self._one.functions.answer.values(self._part("answer")), self._part("solved")[:, 0] > 0
        return Decided(answer, self._one.qp.layout, solved, *self._answered)

    @cached_property
    def parts(self) -> list[Estimates]:
        """Estimates of the policy, of the identified robot, of the controller's own estimators."""
        return self._parts or estimated(self._one, self._report)

    @cached_property
    def estimates(self) -> Estimates:
        """In all."""
        first, *others = self.parts
        return sum(others, first)

    def _part(self, name: str) -> Array:
        return self._report[:, self._one.places[name]]

    def _faults(self) -> dict[int, str]:
        found = dict[int, str]()
        for i in self._part("fault")[:, 0].nonzero()[0].tolist():
            kind = int(self._part("fault")[i, 0])
            if i in self.errors:
                continue
            if kind == DISAGREEMENT:
                touchdowns, steps = (self._part(name)[i].item() for name in ("touchdowns", "index"))
                found[i] = f"contact disagreement: {touchdowns:g} touchdowns, {steps:g} steps"
            elif kind == UNSOLVED:
                found[i] = f"no solver answered: {self._answered[1][i]}"
            else:
                found[i] = f"torque not finite: {self._part('wanted')[i].tolist()} N m"
        return found


def estimated(one: ControllerParts, report: Array) -> list[Estimates]:
    """Of no policy; then of the identified robots, where there are such."""
    none = one.qp.no_error()
    n, alpha, error = len(report), none.alpha.shape, one.functions.estimates["output_error"]
    shapes = (n, *alpha), (n, alpha[0]), (n, alpha[1], error // alpha[1])
    parts = [Estimates(*(np.zeros(shape) for shape in shapes))]
    if one.functions.identifies:
        found = (report[:, one.places[f"identified_{name}"]] for name in ("alpha", "beta", "output_error"))
        parts.append(Estimates(*(each.reshape(shape) for each, shape in zip(found, shapes, strict=True))))
    return parts


def scene_of(one: ControllerParts, rows: Array, errors: dict[int, str]) -> BatchScene:
    """Of rows that begin with those of a scene."""
    part = {name: rows[:, place] for name, (place, _) in one.functions.scene.places.items()}
    index, seen = part["index"][:, 0].astype(int), one.functions.seen.values(part["seen"])
    touchdowns = part["touchdowns"][:, 0]
    wrong = [i for i in (touchdowns != index).nonzero()[0].tolist() if i not in errors]
    return BatchScene(
        x=part["x"],
        seen=seen,
        force=part["force"].reshape(-1, 2, 2),
        observation=seen.observation[:, : one.observed],
        tick=part["tick"][:, 0].astype(int),
        torque=part["torque"],
        stance=part["stance"][:, 0].astype(int),
        step_index=index,
        step_time=part["step_time"][:, 0],
        model_error=one.model_error,
        errors=errors,
        faults={i: f"contact disagreement: {touchdowns[i]:g} touchdowns, {index[i]} steps" for i in wrong},
    )


class BatchController:
    """N robots under copies of one `controller`, each with its policy; several may have the same one.

    One object serves one thread.
    """

    def __init__(self, controller: ControllerParts, policies: Sequence[Policy]) -> None:
        n, tick = len(policies), controller.qp
        self._one, self.policies, self._n = controller, list(policies), n
        self._estimators = [[each.another() for each in controller.estimators] for _ in policies]
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
        self._tick, self._touchdowns = (given[name][:, 0] for name in ("tick", "touchdowns"))
        self._previews = list[Any]([()] * n)  # whose numbers are in the rows
        self._is_sound, self._to_memory = self._one.places["is_sound"].start, self._one.places["memory"]
        self._silence, self._is_silent = np.zeros((n, JOINTS)), True
        self._path = f.memory.places

    @property
    def parameters(self) -> "ControllerParameters":
        """They are all robots'."""
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
        """Of all robots; where `gains` change, this tick's V cannot be compared with the last one's."""
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
        for part in (self.policies[i], *self._estimators[i], self._solvers[i]):
            if part:
                part.reset()

    def keep(self, rows: Array) -> None:
        """Go on with some of the robots, by number."""
        memory, settings, reading = self._rows.memory[rows], self._rows.settings[rows], self._rows.reading[rows]
        for name in ("policies", "_estimators", "_solvers", "_rngs"):
            setattr(self, name, [getattr(self, name)[i] for i in rows])
        self._memory.keep(rows)
        self._n = len(rows)
        self._bind(memory[0], self._n)
        self._rows.memory[:], self._rows.settings[:], self._rows.reading[:] = memory, settings, reading

    def step(self, states: "RobotStates | RobotState") -> BatchOutput:
        """The torques for one tick; see `Controller.step`. Those of a state that is refused mean nothing."""
        policy = None if self._estimators[0] else self._only_policy()
        if policy is None:
            return self.decide(self.look(states))
        start, rows, n = perf_counter(), self._rows, self._n
        self._read(states)
        omega, parts, is_sound, solver, status = self._noise(), None, False, ["daqp"] * n, ["solved"] * n
        if type(policy) is ZeroPolicy and self._one.solvers[0] == "daqp":
            report = rows.step().copy()
            is_sound = 0.0 not in report[:, self._is_sound].tolist()
        if not is_sound:
            parts = self._learned(policy, rows.look())
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
        return BatchOutput(self._one, report, self.policies[:], omega, answered, errors, is_sound, parts)

    def _only_policy(self) -> LearnedPolicy | None:
        """That of all robots, where it needs nothing but the observation and always gives an output error."""
        policy = self.policies[0]
        if isinstance(policy, LearnedPolicy) and (type(policy) is ZeroPolicy or policy.is_structured):
            return policy if self.policies == [policy] * self._n else None
        return None

    def _learned(self, policy: LearnedPolicy, seen: Array) -> list[Estimates]:
        """The estimates of the policy and of the identified robots, into the rows."""
        at = self._one.functions.seen.places
        if type(policy) is ZeroPolicy:
            parts = estimated(self._one, seen)
            return self._take(parts, sum(parts[1:], parts[0]))
        here = self._one.places["seen"].start
        observation, LgV = (seen[:, here + at[i][0].start : here + at[i][0].stop] for i in ("observation", "LgV"))
        parts = [policy.act_of_many(observation[:, : self._one.observed], LgV)]
        if self._one.functions.identifies:
            parts += estimated(self._one, seen)[1:]
        return self._take(parts, sum(parts[1:], parts[0]))

    def _take(self, parts: list[Estimates], total: Estimates) -> list[Estimates]:
        """Those in all, into the rows."""
        for name, values in vars(total).items():
            self._rows.estimates[name][...] = 0 if values is None else values.reshape(self._n, -1)
        return parts

    def _noise(self) -> Array:
        """To explore with, (N, 4)."""
        sigma = self._parameters.sigma
        if sigma == 0 and self._is_silent:
            return self._silence
        omega = sigma * np.array([rng.standard_normal(JOINTS) if sigma > 0 else NO_NOISE for rng in self._rngs])
        self._given["noise"][...], self._is_silent = omega, sigma == 0
        return omega

    def look(self, states: "RobotStates | RobotState", is_kept: bool = True) -> BatchScene:
        """What is seen of the states, after those robots have changed legs that came down.

        Where it is not `is_kept`, no robot changes legs, and the next tick will not know of this one.
        """
        rows = self._rows
        self._read(states)
        stood = rows.stand()
        at = self._one.functions.stand.places
        errors = self._errors(states, stood[:, at["refused"][0].start])
        if not is_kept:
            stood[:, at["begins"][0]] = 0
        seen = rows.see().copy()
        if is_kept:
            self._keep(seen, stood, [i for i in range(self._n) if i not in errors])
        self._seen = seen
        return scene_of(self._one, seen, errors)

    def _read(self, states: "RobotStates | RobotState") -> None:
        """Into the rows."""
        given = self._given
        given["q"][...], given["dq"][...], given["contact"][...] = states.q, states.dq, states.contact
        given["applied"][...], self._force[...] = states.applied, states.foot_force
        self._tick[...], self._touchdowns[...] = states.tick, states.touchdowns
        for i, stone in enumerate([states.preview] if isinstance(states, RobotState) else states.previews):
            if stone is not self._previews[i]:
                self._previews[i] = stone
                given["stone"][i] = NO_STONE if stone is None else astuple(stone)

    def _keep(self, seen: Array, stood: Array, robots: list[int]) -> None:
        """Of what is seen, what a second look at the same tick must know."""
        f = self._one.functions
        kept = seen[:, f.scene.places["kept"][0]]
        rows = {name: kept[:, f.kept.places[name][0]] for name in BEGUN}
        rows |= {name: stood[:, f.stand.places[name][0]] for name in ("last_tick", "torque", "held")}
        for name, values in rows.items():
            self._rows.memory[robots, f.memory.places[name][0]] = values[robots]

    def _errors(self, states: Any, refused: Array) -> dict[int, str]:
        """What the controller refuses, by robot."""
        if not refused.any():
            return {}
        found = dict[int, str]()
        for i in refused.nonzero()[0].tolist():
            state = states if isinstance(states, RobotState) else states[i]
            found[i] = f"controller error: {why_refused(state, int(refused[i]))}"
        return found

    def decide(self, scene: BatchScene, estimates: Estimates | None = None, omega: Array | None = None) -> BatchOutput:
        """The torques at these scenes, from all estimators; `estimates` take the place of the policy's."""
        start, rows, f, n = perf_counter(), self._rows, self._one.functions, self._n
        parts, total = self._estimated(scene, estimates)
        for i in range(n) if total.output_error is None else ():
            with refusing(scene.errors, i):
                self._one.check_estimates(total)
        self._take(parts, total)
        omega = self._noise() if omega is None else omega
        acted, solver, status = self._solved()
        known = [i for i in range(n) if i not in scene.errors]
        rows.memory[known] = acted[known, f.acted.places["memory"][0]]
        answered = solver, status, (perf_counter() - start) / n
        report = np.concatenate([self._seen, acted], axis=1)
        output = BatchOutput(self._one, report, self.policies[:], omega, answered, scene.errors, False, parts)
        scene.faults |= output.faults
        return output

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
        policy, n = self.policies[0], self._n
        nothing, *identified = estimated(self._one, self._seen)
        if policy.comes_last or (given is None and isinstance(policy, ZeroPolicy)):
            given = nothing
        elif given is None and isinstance(policy, LearnedPolicy) and len(set(map(id, self.policies))) == 1:
            given = policy.act_of_many(scene.observation, scene.seen.LgV)
        elif given is None:
            given = self._each(self.policies, scene, [self._one.qp.no_error()] * n)
        parts, total = [given, *identified], sum(identified, self._none + given)
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
