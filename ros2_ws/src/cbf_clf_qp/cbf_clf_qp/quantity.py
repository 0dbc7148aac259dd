"""What is constrained and whose error under the nominal model may be estimated: V-dot, B^(r), a force.

value      = a u + b                                  under any model: the same expression, its parameters
measured   = slope (change of `lower` in a tick) / seconds + offset,    slope and offset as the tick began,
             or what a `sensor` says as it ends: no model is asked
rows       = of mu, if the value is such an affine function of mu
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import casadi as ca

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.system import System


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
