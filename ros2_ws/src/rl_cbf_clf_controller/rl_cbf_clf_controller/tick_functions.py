"""A controller's tick as two functions, since the estimates are found between them; nothing is computed twice.

    look      what is seen of a state, and as `prepared` all of the QP that no estimate changes
    answer    of `prepared` and the estimates

What is desired along the path and the means over the last tick [Remark 3] are computed with `look`.
"""

from collections.abc import Sequence

import casadi as ca
from cbf_clf_qp.answer import Answering
from cbf_clf_qp.estimates import measured
from cbf_clf_qp.functions import NumpyFunction, packed
from cbf_clf_qp.qp import is_bounded
from cbf_clf_qp.quantity import Terms
from cbf_clf_qp.tick import MATRICES, Tick
from rabbit_description.state import TICK_SECONDS

from rl_cbf_clf_controller.walking import Walking


def tick_functions(
    walking: Walking, tick: Tick, tick_seconds: float = TICK_SECONDS
) -> tuple[NumpyFunction, Answering, int]:
    """`look` of (x, p but for the `walking.outputs.rates`, path, torque, before), answer, and the size of `before`.

    `before`: `leaves` of the last tick, NaN where there is none; `torque`: of the last tick, (4,), N m.
    """
    system, (answer, prepared) = tick.system, answering(tick)
    leaves, before, means = measuring(tick.terms, tick_seconds)
    inputs = {"x": system.x, "p": system.p, "path": packed(walking.outputs.path), "torque": system.u, "before": before}
    shown = {**tick.reads, "mu_held": walking.output_dynamics(system.u), "measured": means, "leaves": leaves}
    shown |= {"p": system.p, "prepared": prepared}
    along = walking.outputs.along_path([*shown.values()])
    look = NumpyFunction.of("look", inputs, dict(zip(shown, along, strict=True)), MATRICES)
    return look, answer, before.numel()


def answering(tick: Tick) -> tuple[Answering, ca.SX]:
    """The answer to the QP of `prepared` and the estimates; and what is prepared, of x and p."""
    system, names = tick.system, [*tick.data]
    parts, symbols, prepared = parted([*tick.data.values()], ca.vertcat(system.x, system.p))
    estimates = {name: tick.terms.symbols[name] for name in ("alpha", "beta", "output_error")}
    data = dict(zip(names, parts, strict=True))
    return Answering({"prepared": symbols, **estimates}, data, tick.layout, tick.answer.solver), prepared


def measuring(terms: Terms, tick_seconds: float = TICK_SECONDS) -> tuple[ca.SX, ca.SX, ca.SX]:
    """What a state leaves to the next one, symbols for what the last one has left, and of these `measured` (n,)."""
    now = terms.system.x, terms.system.p
    start = tuple(ca.SX.sym("start", symbol.numel()) for symbol in now)
    (means,), before, left = parted([measured(terms, start, now, tick_seconds)], ca.vertcat(*start))
    (leaves,) = ca.substitute([left], start, now)
    return leaves, before, ca.if_else(is_bounded(before), means, ca.SX.nan())


def parted(expressions: Sequence[ca.SX], inputs: ca.SX) -> tuple[list[ca.SX], ca.SX, ca.SX]:
    """The expressions, with symbols for what depends on the `inputs` alone; then these symbols; then their values."""
    rest, symbols, values = ca.extract_parametric(list(expressions), inputs, {"extract_trivial": True})
    return rest, ca.vertcat(*symbols), ca.vertcat(*values)
