"""What is constrained and whose error under the nominal model may be estimated: V-dot, B^(r), a force.

value      = a u + b                                  under any model: the same expression, its parameters
measured   = slope (change of `lower` in a tick) / seconds + offset,    slope and offset as the tick began,
             or what a `sensor` says as it ends: no model is asked
rows       = of mu, if the value is such an affine function of mu
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.system import System

HARD = float("inf")  # weight of a row without slack
LONGEST_NAME = 32  # characters: a message holds no more
Number = ca.SX | float


@dataclass(frozen=True)
class Rows:
    """Named rows `lower <= A mu - slack <= upper` of the QP, k of them, as expressions over mu (m,).

    `slack_weight`: the cost w s^2 of violating a row by s, positive; HARD: no slack. `in_mu`: s is in units of mu, that
    is s times the norm of the row of A is its violation; else in the row's own.
    `rescue` separates a slack of last resort, whose use is published, from one that the problem has (the paper's d).
    """

    names: tuple[str, ...]
    A: ca.SX
    lower: ca.SX
    upper: ca.SX
    slack_weight: Number = HARD
    rescue: bool = True
    in_mu: bool = True


def at_most(
    names: Sequence[str], A: ca.SX, upper: ca.SX, slack_weight: Number, rescue: bool = True, in_mu: bool = True
) -> Rows:
    """`A mu <= upper`, each row with a slack of its own."""
    return Rows(tuple(names), A, ca.SX(-ca.inf * ca.DM.ones(len(names))), upper, slack_weight, rescue, in_mu)


def at_least(names: Sequence[str], A: ca.SX, lower: ca.SX, slack_weight: Number, rescue: bool = True) -> Rows:
    """`A mu >= lower`, each row with a slack of its own."""
    return at_most(names, -A, -lower, slack_weight, rescue)


@dataclass(frozen=True)
class Quantity:
    """Components `names` (n,), their `value` affine in u, and their rows.

    `lower` (k,) with `slope` (n, k) affine: how they are measured; `sensor` (n,): what a sensor says of them.
    `outputs`: y^(r) affine in u, of a CLF; `reads`: what a person may want to see of them at a tick, by name.
    """

    names: tuple[str, ...]
    value: Affine
    rows: Callable[[Affine], list[Rows]]
    lower: ca.SX | None = None
    slope: Affine | None = None
    sensor: ca.SX | None = None
    outputs: Affine | None = None
    reads: Mapping[str, ca.SX] = field(default_factory=dict)

    def on(self, system: System) -> "Quantity":
        """Itself, whatever the system."""
        return self


class Constrained(Protocol):
    """What becomes a quantity on a system: a barrier, a CLF, or a quantity itself."""

    def on(self, system: System) -> Quantity: ...


class Terms:
    """The nominal terms of a tick over mu (m,), of which objectives, rows and corners are made.

    `control` is u and `nominal` are the `quantities` (n,), both affine in mu; `outputs` is y^(r) affine in u, if there
    is a CLF. `estimates` (alpha, beta) and `output_error` (Delta_2, Delta_1), affine in mu, are of the `symbols` that a
    tick's function has as inputs. Without a `control`: that of input-output linearisation [eq:io_input_model], where it
    can be, else u = mu.
    """

    def __init__(self, system: System, constrained: Sequence[Constrained], control: Affine | None = None) -> None:
        self.system, self.quantities = system, tuple(quantity.on(system) for quantity in constrained)
        self.names = tuple(name for quantity in self.quantities for name in quantity.names)
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"quantities {', '.join(self.names)}: expected different names")
        if len(longest := max(self.names, key=len, default="")) > LONGEST_NAME:
            raise ValueError(f"quantity {longest}: expected a name of {LONGEST_NAME} characters at most")
        self.outputs = next((quantity.outputs for quantity in self.quantities if quantity.outputs), None)
        if control is None and self.outputs and self.outputs.a.is_square():
            control = self.outputs.inverse()
        self.control = control or Affine.identity(system.u.numel())
        nothing = Affine(ca.SX(0, system.u.numel()), ca.SX(0, 1))
        self.nominal = Affine.stacked([nothing, *(quantity.value for quantity in self.quantities)]).after(self.control)
        n, m = self.nominal.a.shape
        self.inputs = int(m)
        alpha, beta, error = ca.SX.sym("alpha", n, m), ca.SX.sym("beta", n), ca.SX.sym("output_error", m, m + 1)
        self.symbols = {"x": system.x, "p": system.p, "alpha": alpha, "beta": beta, "output_error": error}
        self.estimates, self.output_error = Affine(alpha, beta), Affine(error[:, :-1], error[:, -1])

    def rows(self, value: Affine) -> list[Rows]:
        """The rows of all quantities, if they are `value` (n,), affine in mu."""
        at = np.cumsum([0, *(len(quantity.names) for quantity in self.quantities)]).tolist()
        parts = zip(self.quantities, ca.vertsplit(value.a, at), ca.vertsplit(value.b, at), strict=True)
        return [row for quantity, a, b in parts for row in quantity.rows(Affine(a, b))]


Constraint = Callable[[Terms], list[Rows]]
