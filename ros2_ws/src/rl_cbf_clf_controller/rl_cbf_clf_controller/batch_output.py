"""What a tick of N robots has seen and decided; of each robot as if it had been alone."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.qp import ROUNDING as AT_BOUND
from rabbit_description.state import Array, Leg

from rl_cbf_clf_controller.controller_output import Acted, ControllerOutput
from rl_cbf_clf_controller.controller_parts import ControllerParts
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import ControllerError, Scene
from rl_cbf_clf_controller.step import DISAGREEMENT, UNSOLVED

LEGS = tuple(Leg)


@dataclass
class BatchScene(Scene):
    """What is seen of N robots.

    `errors`: why the controller refuses a robot's state, `faults`: why its episode must end, both by its number.
    """

    errors: dict[int, str]
    faults: dict[int, str]


@contextmanager
def refusing(errors: dict[int, str], i: int) -> Iterator[None]:
    """What a controller of robot `i` alone would raise becomes that robot's first error; the others go on."""
    try:
        yield
    except (ControllerError, np.linalg.LinAlgError) as error:
        errors.setdefault(i, f"controller error: {error}")


class BatchOutput:
    """What a tick decides, a row a robot; see `ControllerOutput`. `torque` (N, 4): left/right order, saturated, N m.

    `errors`: why the controller refuses a robot's state, `faults`: why its episode must end, both by its number;
    `report` (N, size): see `step.py`; `solvers`: who answered, by robot; `omega` (N, 4): the noise; `total`,
    `learned`: the estimates in all and the policy's, rows as in `StepFunctions.estimates`; `parts`: those of
    each estimator, None: there are no others but the identified robots.
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
        total: Array,
        learned: Array,
        parts: list[Estimates] | None = None,
    ) -> None:
        self._one, self.report, self._policies, self.omega = one, report, policies, omega
        if one.functions.compensation:
            total = total.copy()
            total[:, one.functions.estimates.places["beta"][0]] += self._part("compensation")
        self._answered, self.errors, self._total, self._learned, self._parts = answered, errors, total, learned, parts
        self.solvers = answered[0]
        self.torque = report[:, one.places["command"]]
        self.faults = {} if is_sound else self._faults()

    def __getitem__(self, i: int) -> ControllerOutput:
        """The output of robot `i`."""
        one, row, total = self._one, self.report[i], self._total[i]
        at, parameters = one.output_places, one.parameters
        arrays = {name: row[place] for name, place in at.arrays.items()}
        arrays |= {"alpha": total[at.alpha].reshape(at.shape), "beta": total[at.beta]}
        arrays["nominal_a"] = arrays["nominal_a"].reshape(at.shape)
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
        row, at = self.report[i], self._one.acted_at
        mu, mu_qp, saturated = row[at[0]], row[at[1]], row.item(at[2]) > 0
        fault = self.faults.get(i, "")
        return Acted(self.torque[i], mu, mu_qp, self.omega[i], saturated, self._policies[i].version, fault)

    @cached_property
    def scene(self) -> BatchScene:
        """What was seen."""
        return scene_of(self._one, self.report, self.errors)

    @cached_property
    def decided(self) -> Decided:
        """The answers to the QPs."""
        answer, solved = self._one.functions.answer.values(self._part("answer")), self._part("solved")[:, 0] > 0
        return Decided(answer, self._one.qp.layout, solved, *self._answered)

    @cached_property
    def parts(self) -> list[Estimates]:
        """Estimates of the policy, of the identified robot, of the controller's adaptive law."""
        one = self._one
        parts = self._parts or [estimates_of(one, self._learned), *identified(one, self.report)]
        if one.functions.compensation:
            parts = [*parts, Estimates(np.zeros_like(parts[0].alpha), self._part("compensation"))]
        return parts

    @cached_property
    def estimates(self) -> Estimates:
        """The estimates in all."""
        first, *others = self.parts
        return sum(others, first)

    def _part(self, name: str) -> Array:
        return self.report[:, self._one.places[name]]

    def _faults(self) -> dict[int, str]:
        faults = dict[int, str]()
        for i in self._part("fault")[:, 0].nonzero()[0].tolist():
            kind = int(self._part("fault")[i, 0])
            if i in self.errors:
                continue
            if kind == DISAGREEMENT:
                touchdowns, steps = (self._part(name)[i].item() for name in ("touchdowns", "index"))
                faults[i] = f"contact disagreement: {touchdowns:g} touchdowns, {steps:g} steps"
            elif kind == UNSOLVED:
                faults[i] = f"no solver answered: {self._answered[1][i]}"
            else:
                faults[i] = f"torque not finite: {self._part('wanted')[i].tolist()} N m"
        return faults


def estimates_of(one: ControllerParts, rows: Array) -> Estimates:
    """The estimates in rows as in `StepFunctions.estimates`."""
    n, (_, m) = len(rows), one.output_places.shape
    alpha, beta, error = (rows[:, place] for place, _ in one.functions.estimates.places.values())
    return Estimates(alpha.reshape(n, -1, m), beta, error.reshape(n, m, m + 1))


def identified(one: ControllerParts, report: Array) -> list[Estimates]:
    """The estimates of the identified robots, where there are such."""
    return [estimates_of(one, report[:, one.places["adapted"]])] if one.functions.identifies else []


def scene_of(one: ControllerParts, rows: Array, errors: dict[int, str]) -> BatchScene:
    """The scene in rows that begin with those of a scene."""
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
