"""A task as a safety filter: the input that is nearest to a wanted one, as far as the barriers let it."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from cbf_clf_qp.qp import nearest
from cbf_clf_qp.quantity import Constrained, Quantity
from cbf_clf_qp.system import System
from rabbit_description.task import Commands, ControlTask


@dataclass(frozen=True)
class Unasked:
    """A quantity without rows: it is estimated as before, so that a policy of the task fits, and asks for nothing."""

    quantity: Constrained

    def on(self, system: System) -> Quantity:
        return replace(self.quantity.on(system), rows=lambda value: [])


def filtering(task: ControlTask) -> ControlTask:
    """The task with further parameters, the wanted input u (m,), which come last in p."""
    wanted = {f"wanted_{name}": ca.SX.sym(f"wanted_{name}") for name in task.names_of_u}
    old, barriers = task.system, task.barriers
    system = System(old.x, old.u, old.x_dot, {**old.named, **wanted}, old.rates)

    def commands(rng: np.random.Generator) -> Commands:
        at = task.commands(rng)
        return lambda t: {**at(t), **dict.fromkeys(wanted, 0.0)}

    return replace(
        task,
        system=system,
        quantities=[quantity if quantity in barriers else Unasked(quantity) for quantity in task.quantities],
        objective=lambda terms: nearest(terms.control, ca.vertcat(*wanted.values())),
        observation=task.observed,
        commands=commands,
    )
