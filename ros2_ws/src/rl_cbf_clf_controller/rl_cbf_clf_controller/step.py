"""One tick of a controller as one function of rows of numbers:  memory, report = step(memory, reading, settings).

    stand    reading -> what may be refused; of a walker which leg stands, whether a step begins, the state in its order
    see      scene: what is seen of the state, the identified robot, all of the QP that no estimate changes
    decide   scene, estimates -> the QP by DAQP, exploration, the torque within its limit

`step` is these three, one after another, with the identified robot's estimates or none. Where a policy is asked, it is
asked between `see` and `decide`. Where another solver is, it solves `data`, and `finish` does the rest of `decide`.
All are CasADi functions without a constant that may change as the robot walks; so they run in CasADi's virtual machine,
as C, for one robot or many, and always give the same bits. `rabbit_step.py` says what RABBIT sees, `task_step.py` what
a control task does.
"""

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.answer import TOLERANCE, Answering, by_daqp
from cbf_clf_qp.functions import Layout, NumpyFunction, is_finite, row_by_row
from cbf_clf_qp.tick import Tick
from rabbit_description.state import Array

ROUNDING = 1e-6  # N m, by which the QP may be over the limit
# why a state is refused, or an episode must end
Q, DQ, STONE = 1, 2, 3
DISAGREEMENT, UNSOLVED, NOT_FINITE = 1, 2, 3


def call(function: NumpyFunction, values: Mapping[str, Any]) -> dict[str, ca.MX]:
    """What a function gives of the inputs that it names, by name; a matrix as a column, row by row."""
    row = function.function(*(values[name] for name in function.function.name_in()))
    return {name: row[place] for name, (place, _) in function.places.items()}


def row_function(name: str, inputs: Mapping[str, ca.MX], outputs: Mapping[str, ca.MX]) -> NumpyFunction:
    """A function of columns that gives a row."""
    layout = Layout({name: value.numel() for name, value in outputs.items()})
    function = ca.Function(name, [*inputs.values()], [layout.joined(outputs)], [*inputs], ["values"])
    return NumpyFunction(function, layout.places)


def symbols(sizes: Mapping[str, int]) -> dict[str, ca.SX]:
    """Columns of these sizes."""
    return {name: ca.SX.sym(name, size) for name, size in sizes.items()}


def ordered(values: ca.SX, swapped: Any, is_right: ca.SX) -> ca.SX:
    """The values from left/right in stance/swing order, or back."""
    return ca.if_else(is_right, values[swapped.tolist()], values)


def act_function(m: int, swapped: Any) -> NumpyFunction:
    """What was decided of m inputs, with exploration, within the limit; `swapped`: their order for the other leg."""
    sizes = {"residual": 1, "tolerance": 1, "mu": m, "u": m, "control_a": m**2, "control_b": m}
    sizes |= {"noise": m, "torque_limit": 1, "stance": 1, "index": 1, "touchdowns": 1, "refused": 1}
    s = symbols(sizes)
    solved, limit = s["residual"] < s["tolerance"], s["torque_limit"]
    a, b = row_by_row(s["control_a"], m), s["control_b"]
    mu_qp = ca.if_else(solved, s["mu"], 0)
    explores = ca.mmax(ca.fabs(s["noise"])) > 0
    mu = ca.if_else(explores, mu_qp + s["noise"], mu_qp)
    wanted = ca.if_else(explores, a @ mu + b, ca.if_else(solved, s["u"], b))
    largest = ca.mmax(ca.fabs(wanted))
    torque = ca.fmin(ca.fmax(wanted, -limit), limit)
    saturated = largest > limit + ROUNDING
    mu = ca.if_else(saturated, ca.solve(a, torque - b), mu)
    sound = ca.logic_and(is_finite(wanted), ca.logic_and(is_finite(torque), is_finite(mu)))
    fault = ca.if_else(sound, ca.if_else(solved, 0, UNSOLVED), ca.if_else(solved, NOT_FINITE, UNSOLVED))
    fault = ca.if_else(s["touchdowns"] != s["index"], DISAGREEMENT, fault)
    torque, mu, mu_qp = (ca.if_else(sound, value, 0) for value in (torque, mu, mu_qp))
    outputs = {"stance_torque": torque, "command": ordered(torque, swapped, s["stance"]), "mu": mu, "mu_qp": mu_qp}
    outputs |= {"saturated": ca.logic_and(saturated, sound), "solved": solved, "fault": fault, "wanted": wanted}
    outputs["is_sound"] = ca.logic_not(ca.logic_or(s["refused"], fault))
    return NumpyFunction.of("act", s, outputs)


class StepFunctions:
    """The functions of a tick, see the module. What a subclass sees of a state it says in `stand` and `see`.

    Each gives a row, with the layout `memory`, `scene` (of `see`), `acted` (of `decide` and `finish`) or `report` (of
    `step`: both). `seen`, `answer`: the functions whose rows are in a scene, and in what was `acted`; `kept`: what a
    scene keeps for the next tick; `gaits`: numbers that stay as they are.
    """

    stand: NumpyFunction
    see: NumpyFunction
    seen: NumpyFunction
    kept: Layout
    gaits: Array
    identifies = False
    compensation: NumpyFunction | None = None  # of what is seen and estimated, see `l1_adaptation.py`

    def first(self, parameters: Any) -> Array:
        """The memory with which an episode begins."""
        return np.zeros(self.memory.size)

    def declare(self, tick: Tick, answering: Answering, memory: Layout, reading: Layout, settings: Layout) -> None:
        """The rows that are given, and their symbols."""
        self.programme, self.answer = answering.programme, answering.reading
        self.memory, self.reading, self.settings = memory, reading, settings
        n, m = len(tick.names), tick.terms.inputs
        self.estimates = Layout({"alpha": n * m, "beta": n, "output_error": m * (m + 1)})
        rows = {"memory": memory.size, "reading": reading.size, "settings": settings.size}
        self._rows = {name: ca.MX.sym(name, size) for name, size in rows.items()}
        self._gaits = ca.MX.sym("gaits", self.gaits.size)
        self._columns = [getattr(self, name).parts(row) for name, row in self._rows.items()]

    def compose(self, swapped: Any) -> None:
        """Composes the other functions of `stand` and `see`; `swapped`: the order of inputs for the other leg."""
        self.data, self.finish, self.decide = self._decide(swapped)
        self.look, self.step = self._step()

    def _decide(self, swapped: Any) -> tuple[NumpyFunction, ...]:
        """`data` of the QP; `finish`, with an answer to it; `decide`, with DAQP's."""
        self.scene = Layout.of(self.see)
        _, reading, settings = self._columns
        scene_row, tolerance = ca.MX.sym("scene", self.scene.size), ca.MX.sym("tolerance")
        scene = self.scene.parts(scene_row)
        estimates = ca.MX.sym("estimates", self.estimates.size)
        seen, kept = Layout.of(self.seen).parts(scene["seen"]), self.kept.parts(scene["kept"])
        known, compensation = self.estimates.parts(estimates), dict[str, ca.MX]()
        if self.compensation:
            compensation = call(self.compensation, {**seen, **kept, **known, "torque": scene["torque"]})
            known["beta"] += compensation["compensation"]
        programme = call(self.programme, {**known, "prepared": seen["prepared"]}) | compensation
        data = row_function("data", {"scene": scene_row, "estimates": estimates}, programme)
        data_row = ca.MX.sym("data", data.row.size)
        x, y = (ca.MX.sym(name, self.answer.function.numel_in(name)) for name in "xy")
        compensation = {name: data_row[data.places[name][0]] for name in compensation}
        answer_row = self.answer.function(data_row[: self.programme.row.size], x, y)
        answer = Layout.of(self.answer).parts(answer_row)
        acts = act_function(self.reading.sizes["noise"], swapped)
        acted = call(acts, {**settings, **reading, **scene, **answer, "tolerance": tolerance})
        memory = {**kept, "torque": acted["stance_torque"], "held": acted["command"], **compensation}
        report = {"memory": self.memory.joined(memory), **acted, "answer": answer_row}
        report |= {name: compensation[name] for name in compensation if name != "adaptive"}
        rows = {"reading": self._rows["reading"], "settings": self._rows["settings"], "scene": scene_row}
        finish = row_function("finish", {**rows, "data": data_row, "x": x, "y": y, "tolerance": tolerance}, report)
        qp = data.function(scene_row, estimates)
        solution = by_daqp(qp, self.programme.places)
        inputs = {**rows, "estimates": estimates}
        row = finish.function(*rows.values(), qp, *solution, TOLERANCE)
        decide = NumpyFunction(ca.Function("decide", [*inputs.values()], [row], [*inputs], ["values"]), finish.places)
        return data, finish, decide

    def _step(self) -> tuple[NumpyFunction, NumpyFunction]:
        """`look`: stand and see. `step`: all, with the identified robot's estimates or none."""
        self.acted = Layout.of(self.finish)
        self.report = Layout(self.scene.sizes | self.acted.sizes)
        inputs = {**self._rows, "gaits": self._gaits}
        scene_row = self.see.function(*inputs.values(), self.stand.function(*self._rows.values()))
        look = ca.Function("look", [*inputs.values()], [scene_row], [*inputs], ["values"])
        scene = self.scene.parts(scene_row)
        known = scene.get("adapted", ca.DM.zeros(self.estimates.size))
        acted = self.decide.function(self._rows["reading"], self._rows["settings"], scene_row, known)
        step = ca.Function("step", [*inputs.values()], [ca.vertcat(scene_row, acted)], [*inputs], ["values"])
        return NumpyFunction(look, self.scene.places), NumpyFunction(step, self.report.places)
