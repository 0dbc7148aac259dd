"""One tick of a CBF-CLF-QP: from a state's terms and estimates to mu and the input. Read this file first.

    u       = precontrol(mu)                              from the nominal model, see `io_linearization.py`
    nominal = quantities by the nominal model             affine in mu
    value   = nominal + alpha mu + beta                   the sum of all estimators: policy, identified model, oracle
    measured = of two scenes, one tick apart              what a learner compares the nominal value with
    rows    = of each quantity, if it has that value, and of further constraints
    mu      = argmin objective  subject to rows           see `qp.py`

A `Recipe` says which quantities, estimators, constraints and objective a controller has. The functions here know no
robot, and keep nothing from tick to tick but what the solver and the estimators keep.
"""

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.objective import Objective
from cbf_clf_qp.qp import Decision, QuadraticProgram, build_qp
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.solvers import Solution, Solver, kkt_residuals
from cbf_clf_qp.tracing import Traced

Scene = TypeVar("Scene")  # what the quantities read of a state: outputs, feet, obstacles
SceneRead = TypeVar("SceneRead", contravariant=True)


class Quantity(Protocol[SceneRead]):
    """Something that is constrained and whose error under the nominal model may be estimated: V-dot, B-ddot, a force.

    `names` has one for each of its components.
    """

    @property
    def names(self) -> tuple[str, ...]: ...

    def predict(self, scene: SceneRead, dynamics: Any) -> Affine:
        """The components (k,), affine in the input u, under any model's `dynamics`."""

    def measure(self, before: SceneRead, after: SceneRead, seconds: float) -> Array:
        """The components (k,), their mean over the `seconds` between two scenes, with no word of any model."""

    def rows(self, scene: SceneRead, value: Affine) -> list[Rows]:
        """The rows over mu, if the components are `value`, affine in mu."""


@dataclass
class Terms(Generic[Scene]):
    """The model's terms of one tick, before any decision: `precontrol` is u, `nominal` the quantities, over mu."""

    quantities: tuple[Quantity[Scene], ...]
    scene: Scene
    dynamics: Any
    precontrol: Affine
    nominal: Affine

    @classmethod
    def of(
        cls, quantities: tuple[Quantity[Scene], ...], scene: Scene, dynamics: Any, precontrol: Affine
    ) -> "Terms[Scene]":
        """At a scene, under the nominal `dynamics`."""
        nominal = predicted(quantities, scene, dynamics).after(precontrol)
        return cls(quantities, scene, dynamics, precontrol, nominal)

    def under(self, dynamics: Any) -> Affine:
        """The quantities under another model's `dynamics`, affine in mu."""
        return predicted(self.quantities, self.scene, dynamics).after(self.precontrol)


class Pending(Protocol):
    """Estimates that the tick's trace is to work out: a dataclass of numbers, such as a network's outputs."""

    def at(self, terms: Terms[Any]) -> Estimates:
        """Worked out at a tick's terms, of which the `quantities` are not known to a trace."""


class Estimator(ABC, Generic[Scene]):
    """What says how wrong the nominal quantities are: a policy, an identified model, bounds on the error."""

    @abstractmethod
    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        """Alpha and beta of every quantity, to be added to those of the estimators `before`."""

    def pending(self, terms: Terms[Scene], before: Sequence[Pending]) -> Pending:
        """The same, or what remains to be worked out; called once a tick."""
        return self.estimate(terms, total(before, terms))

    def reset(self) -> None:
        """Begin an episode: forget what the last one taught."""


class Constraint(Protocol):
    """Rows on what is not estimated, such as the input itself."""

    def rows(self, terms: Terms[Any], control: Affine) -> list[Rows]:
        """The rows over mu, at u = `control`(mu)."""


def least_mu(terms: Terms[Any], estimates: Estimates) -> None:
    """The paper's objective, mu' mu."""


@dataclass(frozen=True)
class Recipe(Generic[Scene]):
    """What a controller is made of.

    `estimators`: their estimates are added. None: the nominal controller.
    `corrects_input`: the estimates are no errors of quantities but a part of the input, u = precontrol(mu + alpha mu +
    beta), as in the first approach [approach1_input].
    `objective`: None is the paper's, mu' mu.
    """

    quantities: tuple[Quantity[Scene], ...]
    constraints: tuple[Constraint, ...] = ()
    estimators: tuple[Estimator[Scene], ...] = ()
    corrects_input: bool = False
    objective: Callable[[Terms[Scene], Estimates], Objective | None] = least_mu

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of all quantities, in the order of every array over them."""
        return tuple(name for quantity in self.quantities for name in quantity.names)

    @cached_property
    def programme(self) -> Traced:
        """The QP of a tick, as `traced_programme` has it."""
        return traced_programme(*self._of_programme).twin()

    @cached_property
    def reading(self) -> Traced:
        """What a solution says, as `traced_reading` has it."""
        return traced_reading(*self._of_programme).twin()

    @property
    def _of_programme(self) -> tuple[Any, ...]:
        return self.quantities, self.constraints, self.corrects_input, self.objective


@dataclass
class Decided(Decision):
    """All of a tick: what the solver's `solution` of the `qp` says, and u = `control`(mu).

    `parts` are the estimates of each estimator, `estimates` their sum. `mu` and `u` count only if `solution.solved`.
    """

    parts: tuple[Estimates, ...]
    estimates: Estimates
    control: Affine
    solution: Solution

    @property
    def mu(self) -> Array:
        """The auxiliary input (m,)."""
        mu: Array = self.solution.read[1]
        return mu

    @property
    def u(self) -> Array:
        """The input (m,)."""
        u: Array = self.solution.read[2]
        return u


def decide(recipe: Recipe[Scene], terms: Terms[Scene], solver: Solver) -> Decided:
    """The tick."""
    pending = tuple[Pending, ...]()
    for estimator in recipe.estimators:
        pending = (*pending, estimator.pending(terms, pending))
    of_terms = terms.scene, terms.dynamics, terms.precontrol, terms.nominal
    control, qp, estimates, parts = recipe.programme(*of_terms, pending)
    solution = solver.solve(qp, lambda qp, x, y: recipe.reading(qp, control, x, y))
    return Decided(qp, solution.x, parts, estimates, control, solution)


@lru_cache(maxsize=64)
def traced_programme(
    quantities: tuple[Quantity[Any], ...],
    constraints: tuple[Constraint, ...],
    corrects_input: bool,
    objective: Callable[[Terms[Any], Estimates], Objective | None],
) -> Traced:
    """The control as it is corrected, the QP, the estimates' sum and each of them, of recipes with these parts."""
    recipe = Recipe(quantities, constraints, (), corrects_input, objective)

    def programme(
        scene: Any, dynamics: Any, precontrol: Affine, nominal: Affine, pending: Sequence[Pending]
    ) -> list[Any]:
        terms, control = Terms(quantities, scene, dynamics, precontrol, nominal), precontrol
        parts = tuple(part.at(terms) for part in pending)
        estimates = total(parts, terms)
        if corrects_input:
            control = control.after(Affine.identity(len(control.b)) + estimates.affine)
        qp = build_qp(rows_of(recipe, terms, estimates, control), objective(terms, estimates))
        return [control, qp, estimates, parts]

    return Traced(programme, (quantities, constraints, objective))


@lru_cache(maxsize=64)
def traced_reading(*of_programme: Any) -> Traced:
    """Of a solver's answer to a programme of recipes with these parts: the KKT residuals, mu, and u = control(mu)."""

    def reading(qp: QuadraticProgram, control: Affine, x: Array, y: Array) -> list[Any]:
        mu = Decision(qp, x).mu
        return [kkt_residuals(qp, x, y), mu, control(mu)]

    return Traced(reading)


def total(parts: Sequence[Pending], terms: Terms[Any]) -> Estimates:
    """The sum of what several estimators say; of none, that there is no error."""
    estimates = [part.at(terms) for part in parts] or [Estimates.zero(*terms.nominal.a.shape)]
    return reduce(operator.add, estimates)


def rows_of(recipe: Recipe[Scene], terms: Terms[Scene], estimates: Estimates, control: Affine) -> list[Rows]:
    """Which QP has which rows: those of the quantities, at each corner of the estimates, and of the constraints."""
    value = terms.nominal if recipe.corrects_input else terms.nominal + estimates.affine
    cases = [value + corner for corner in estimates.corners] or [value]
    return [
        *(block for case in cases for block in quantity_rows(recipe, terms.scene, case)),
        *(block for constraint in recipe.constraints for block in constraint.rows(terms, control)),
    ]


def measured(quantities: Sequence[Quantity[Scene]], before: Scene, after: Scene, seconds: float) -> Array:
    """All quantities (n,) over the `seconds` between two scenes."""
    return np.concatenate([quantity.measure(before, after, seconds) for quantity in quantities])


def quantity_rows(recipe: Recipe[Scene], scene: Scene, value: Affine) -> list[Rows]:
    """The rows of all quantities, if they are `value` (n,), affine in mu."""
    rows, start = list[Rows](), 0
    for quantity in recipe.quantities:
        end = start + len(quantity.names)
        rows += quantity.rows(scene, Affine(value.a[start:end], value.b[start:end]))
        start = end
    return rows


def predicted(quantities: Sequence[Quantity[Scene]], scene: Scene, dynamics: Any) -> Affine:
    """All quantities (n,), affine in the input, under a model's `dynamics`."""
    return Affine.stacked([quantity.predict(scene, dynamics) for quantity in quantities])
