"""The model's error: for each quantity one that is affine in mu. What is known of it, and how it is measured.

    true value = nominal value(mu) + alpha(x) mu + beta(x)        [CLF_estimate], [eq:cbf_der], [eq_const]

A policy learns them, an identified model computes them, an oracle has them; the estimates of several are added.
`measure` says what the quantities really were over a tick: it asks no model and takes one difference [Remark 3]; a
learner compares that with the nominal value. `model_error` gives the estimates that turn the nominal model into another
one: those of an oracle, or of a robot that has been identified.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import Array, NumpyFunction, one_at_a_time
from cbf_clf_qp.quantity import Number, Terms
from cbf_clf_qp.system import System

Pair = tuple[ca.SX, ...]  # a state x and the parameters p there


@dataclass  # not frozen: that would take a tick 1 us for each
class Estimates:
    """`alpha` (n, m) and `beta` (n,) of n quantities over mu (m,), in the quantities' units (alpha: per unit of mu).

    `output_error` (m, m + 1): (Delta_2 | Delta_1), the error Delta_2 mu + Delta_1 of y^(r) = mu; None: not known.
    Those of N robots have a row for each. Raises ValueError for shapes that do not fit together.
    """

    alpha: Array
    beta: Array
    output_error: Array | None = None

    def __post_init__(self) -> None:
        if not self.beta.ndim or self.alpha.shape[:-1] != self.beta.shape:
            raise ValueError(f"estimates: alpha {self.alpha.shape}, beta {self.beta.shape}; expected (n, m) and (n,)")

    def __add__(self, other: "Estimates") -> "Estimates":
        """Both errors together; the output error is known if both know it."""
        mine, others = self.output_error, other.output_error
        known = None if mine is None or others is None else mine + others
        return Estimates(self.alpha + other.alpha, self.beta + other.beta, known)

    def __getitem__(self, i: int) -> "Estimates":
        """The estimates of robot `i` of N."""
        return Estimates(self.alpha[i], self.beta[i], None if self.output_error is None else self.output_error[i])

    @classmethod
    def of_many(cls, estimates: Sequence["Estimates"]) -> "Estimates":
        """The estimates of N robots, from those of each; the output errors are known if all are."""
        alpha, beta, errors = zip(*(vars(robot).values() for robot in estimates), strict=True)
        known = None if any(error is None for error in errors) else np.array(errors)
        return cls(np.array(alpha), np.array(beta), known)

    @classmethod
    def zero(cls, n: int, m: int) -> "Estimates":
        """No error anywhere: the nominal controller."""
        return cls(np.zeros((n, m)), np.zeros(n), np.zeros((m, m + 1)))

    def error(self, mu: Array) -> Array:
        """The errors (n,) at `mu` (m,)."""
        error: Array = self.alpha @ mu + self.beta
        return error


@one_at_a_time
def measure(terms: Terms) -> NumpyFunction:
    """`measured` (n,) of (x_0, p_0, x_1, p_1, seconds): the means of all quantities between two states.

    Raises ValueError for a quantity of relative degree 3 or more: one difference does not isolate its error.
    """
    x, p, seconds = terms.system.x, terms.system.p, ca.SX.sym("seconds")
    start, end = ((ca.SX.sym("x", x.numel()), ca.SX.sym("p", p.numel())) for _ in range(2))
    symbols = dict(zip(("x_0", "p_0", "x_1", "p_1", "seconds"), (*start, *end, seconds), strict=True))
    return NumpyFunction.of("measure", symbols, {"measured": measured(terms, start, end, seconds)})


def measured(terms: Terms, start: Pair, end: Pair, seconds: Number) -> ca.SX:
    """The means of all quantities from (x, p) to (x, p) as an expression; raises ValueError."""
    x, p, means = terms.system.x, terms.system.p, list[ca.SX]()
    for quantity in terms.quantities:
        if quantity.sensor is not None:
            means += ca.substitute([quantity.sensor], [x, p], end)
        elif quantity.lower is not None and quantity.slope is not None:
            (before,), (after,) = (ca.substitute([quantity.lower], [x, p], at) for at in (start, end))
            slope = Affine(*ca.substitute([quantity.slope.a, quantity.slope.b], [x, p], start))
            means.append(slope((after - before) / seconds))
        else:
            raise ValueError(f"{quantity.names[0]}: one difference measures relative degrees 1 and 2 only (Remark 3)")
    return ca.vertcat(*means)


@one_at_a_time
def model_error(terms: Terms) -> NumpyFunction:
    """`alpha` (n, m), `beta` (n,), `output_error` (m, m + 1) of (x, p, other): the parameters of another model.

    The other model says how the state moves. What a barrier or an output is of a state does not change with it, nor do
    its lower derivatives, but for relative degrees of 3 or more. The error is zero where the two models are the same.
    `output_error` is zero, too, where outputs and inputs differ in number: then y^(r) is not mu.
    """
    system, other = terms.system, ca.SX.sym("other", terms.system.p.numel())
    (x_dot,) = ca.substitute([system.x_dot], [system.p], [other])
    moved = System(system.x, system.u, x_dot, {**system.named, "other": other}, system.rates)
    values, y_r = list[Affine](), terms.outputs
    for quantity in terms.quantities:
        is_output = quantity.outputs is not None and quantity.outputs is terms.outputs
        if quantity.lower is None or quantity.slope is None:
            values.append(_by(quantity.value, system.p, other))
            y_r = _by(quantity.outputs, system.p, other) if quantity.outputs and is_output else y_r
        else:
            rate = moved.affine(moved.derivative(quantity.lower))
            values.append(quantity.slope.after(rate))
            y_r = rate if is_output else y_r
    error = Affine.stacked(values).after(terms.control) - terms.nominal
    delta = Affine(ca.SX.zeros(terms.inputs, terms.inputs), ca.SX.zeros(terms.inputs))
    if y_r and terms.outputs and terms.outputs.a.is_square():
        delta = y_r.after(terms.control) - terms.outputs.after(terms.control)
    outputs = {"alpha": error.a, "beta": error.b, "output_error": ca.horzcat(delta.a, delta.b)}
    inputs = {"x": system.x, "p": system.p, "other": other}
    return NumpyFunction.of("model_error", inputs, outputs, matrices=("alpha", "output_error"))


def _by(value: Affine, p: ca.SX, other: ca.SX) -> Affine:
    """The same expression with the `other` parameters."""
    return Affine(*ca.substitute([value.a, value.b], [p], [other]))
