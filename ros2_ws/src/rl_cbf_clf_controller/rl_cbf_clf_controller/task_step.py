"""A control task's tick as one function, see `step.py`.

A tick measures what its quantities were over the last one, under the input that was decided there, unless a tick is
missing between the two, or the state has jumped.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import Layout, NumpyFunction, is_finite
from cbf_clf_qp.quantity import Terms
from cbf_clf_qp.tick import MATRICES
from rabbit_description.task import ControlTask

from rl_cbf_clf_controller.step import DQ, Q, StepFunctions, call, row_function, symbols
from rl_cbf_clf_controller.tick_functions import answering, measuring

PARAMETERS = 3  # why a state is refused


@dataclass(frozen=True)
class TaskParameters:
    """What may be set of a task's controller: exploration. `torque_limit`: of the input; inf: there is none."""

    objective: str
    torque_limit: float
    sigma: float = 0.0
    qp_solver: str = "daqp"
    adaptation: str = "none"


class TaskStep(StepFunctions):
    """The step of a task."""

    gaits = np.zeros(1)

    def __init__(self, task: ControlTask) -> None:
        self.task, tick, m = task, task.tick, task.system.u.numel()
        answer, prepared = answering(tick)
        leaves, before, means = measured_over(tick.terms, task.seconds)
        self.seen = look_function(task, {"measured": means, "leaves": leaves, "prepared": prepared}, before)
        n = len(task.names_of_q)
        sizes = {"tick": 1, "touchdowns": 1, "q": n, "dq": n, "parameters": task.system.p.numel(), "noise": m}
        memory = {"last_tick": 1, "impacts": 1, "left": before.numel(), "torque": m}
        self.declare(tick, answer, Layout(memory), Layout(sizes), Layout({"torque_limit": 1}))
        self.stand = self._stand()
        self.see = self._see()
        self.compose(np.arange(m))

    def first(self, parameters: TaskParameters) -> np.ndarray:
        row = np.full(self.memory.size, np.nan)
        row[self.memory.places["last_tick"][0]] = -2  # a tick that none follows
        return row

    def _stand(self) -> NumpyFunction:
        """Whether the reading is `refused`, and `x`."""
        s = symbols({name: self.reading.sizes[name] for name in ("q", "dq", "parameters")})
        x = ca.vertcat(s["q"], s["dq"])[: self.task.system.x.numel()]
        refused = ca.if_else(is_finite(s["parameters"]), 0, PARAMETERS)
        refused = ca.if_else(is_finite(x), refused, ca.if_else(is_finite(s["q"]), DQ, Q))
        function = NumpyFunction.of("state", s, {"refused": refused, "x": x})
        return row_function("stand", self._rows, call(function, self._columns[1]))

    def _see(self) -> NumpyFunction:
        memory, reading, _ = self._columns
        stood_row = ca.MX.sym("stood", self.stand.row.size)
        stood, tick, impacts = Layout.of(self.stand).parts(stood_row), reading["tick"], reading["touchdowns"]
        follows = ca.logic_and(memory["last_tick"] == tick - 1, memory["impacts"] == impacts)
        last = memory["left"], memory["torque"]
        left, torque = (ca.if_else(follows, value, ca.DM.nan(value.numel())) for value in last)
        seen_row = self.seen.function(stood["x"], reading["parameters"], torque, left)
        seen = Layout.of(self.seen).parts(seen_row)
        kept = {"last_tick": tick, "impacts": impacts, "left": seen["leaves"]}
        self.kept = Layout({name: self.memory.sizes[name] for name in kept})
        scene = {"seen": seen_row, "kept": self.kept.joined(kept), "x": stood["x"], "refused": stood["refused"]}
        scene |= {"tick": tick, "touchdowns": impacts, "index": impacts, "stance": ca.MX(0)}
        scene["step_time"] = tick * self.task.seconds
        return row_function("see", {**self._rows, "gaits": self._gaits, "stood": stood_row}, scene)


def look_function(task: ControlTask, shown: dict[str, ca.SX], before: ca.SX) -> NumpyFunction:
    """What is seen of (x, p, the last tick's input, what that left): all that `ControlTask.tick` reads, and `shown`."""
    system, tick, m = task.system, task.tick, task.tick.terms.inputs
    control, nan = tick.terms.control, ca.SX.nan
    reads = {"V": nan(), "eta": ca.SX(0, 1), **tick.reads, "phase": nan(), "barrier_rates": nan(len(task.barriers))}
    reads["LgV"] = tick.terms.nominal.a[tick.names.index("V"), :].T if "V" in tick.names else ca.SX.zeros(m)
    reads |= {"mu_held": ca.solve(control.a, system.u - control.b), "p": system.p, **shown}
    inputs = {"x": system.x, "p": system.p, "torque": system.u, "before": before}
    return NumpyFunction.of("look", inputs, reads, MATRICES)


def measured_over(terms: Terms, seconds: float) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The same as `measuring`; NaN where one difference does not measure the quantities, so that nothing is learned."""
    try:
        return measuring(terms, seconds)
    except ValueError:
        return ca.SX(0, 1), ca.SX(0, 1), ca.SX.nan(len(terms.names))
