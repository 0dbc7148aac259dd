"""A control task: a system, what constrains it, what its model believes, what is true. One such object is a whole file.

    x-dot = f(x, p) + g(x, p) u      the model has the `nominal` parameters, the plant the `true` ones
    p = (uncertain, commanded)       masses and the like, and what changes in an episode: a target, an obstacle

For example a cart that must stop before a wall, and is twice as heavy as its model:

    x, v, u, mass, target = (ca.SX.sym(name) for name in ("x", "v", "u", "mass", "target"))
    cart = System(ca.vertcat(x, v), u, ca.vertcat(v, u / mass), parameters=[mass, target])
    TASK = ControlTask(
        "cart", cart, [Clf(x - target), Barrier("wall", 1 - x, poles=(4, 4))], limit=20.0,
        nominal={"mass": 1.0}, true={"mass": 2.0}, start=((-0.1, 0.0), (0.1, 0.0)),
        commands=lambda rng: lambda t: {"target": 1.2},
    )
"""

import importlib.util
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.constraints import Barrier
from cbf_clf_qp.functions import Array, NumpyFunction
from cbf_clf_qp.quantity import Constrained, Terms
from cbf_clf_qp.system import System
from cbf_clf_qp.tick import Tick
from rabbit_description import plugins

from own_systems.shapes import Shape

GROUP = "rabbit.systems"  # entry points that name a ControlTask
SUBSTEP = 0.001  # s, of the plant's integration, at most
Commands = Callable[[float], Mapping[str, float]]
OwnController = Callable[[Array, Array], Array]


class TaskError(ValueError):
    """A task whose parts do not fit together, or a file without one; the message is one line."""


@dataclass(frozen=True, eq=False)
class ControlTask:
    """A system with all that a run of it needs.

    Args:
        name: of the task; a policy that was trained for it bears it.
        system: its state x is (q, q') if it has two components for each of `coordinates`, else q alone.
        quantities: CLF and barriers, see `cbf_clf_qp.constraints`.
        nominal: the parameters that the model has, by name; `true`: those of the plant that differ.
        start: the least and the greatest first state (n,); each episode draws one.
        commands: of an episode's random generator: a function of time (s) that gives all other parameters.
        limit: of |u|, each component.
        seconds, duration: of a tick and of an episode.
        observation: what a policy reads, by name; None: the state.
        failed: positive where an episode has failed, an expression of x and p.
        tolerance: by how much a barrier may be negative and still counts as kept, in its own unit.
        objective: see `Tick`; None: the least mu.
        coordinates: names of q; none: x1, x2, ... inputs: names of u; none: u1, u2, ...
        draw: shapes in the plane for a state x and parameters p (a mapping by name).
        controllers: further ones by name, u (m,) of (x, p): end to end, without a QP.
        plant: the next state of (x, p, u) in place of the system's own integration.

    Raises:
        TaskError: names the field, what it is and what was expected.
    """

    name: str
    system: System
    quantities: Sequence[Constrained]
    nominal: Mapping[str, float]
    true: Mapping[str, float]
    start: tuple[Sequence[float], Sequence[float]]
    commands: Callable[[np.random.Generator], Commands] = field(default=lambda rng: lambda t: {})
    limit: float | None = None
    seconds: float = 0.01
    duration: float = 5.0
    observation: Mapping[str, ca.SX] | None = None
    failed: ca.SX | None = None
    tolerance: float = 0.01
    objective: Callable[[Terms], Affine | None] | None = None
    coordinates: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    draw: Callable[[Array, Mapping[str, float]], Sequence[Shape]] | None = None
    controllers: Mapping[str, OwnController] = field(default_factory=dict)
    plant: Callable[[Array, Array, Array], Array] | None = None

    def __post_init__(self) -> None:
        n = self.system.x.numel()
        for name, values, known in (("nominal", self.nominal, self.system.named), ("true", self.true, self.nominal)):
            if strange := sorted(set(values) - set(known)):
                raise TaskError(f"{name} = {', '.join(strange)}: expected some of {', '.join(known)}")
            if wrong := [f"{key} = {value}" for key, value in values.items() if not math.isfinite(value)]:
                raise TaskError(f"{name}: {', '.join(wrong)}: expected finite numbers")
        if any(len(bound) != n for bound in self.start) or np.any(np.greater(*self.start)):
            raise TaskError(f"start = {self.start}: expected the least and the greatest state, {n} numbers each")
        if not 0 < self.seconds <= self.duration < math.inf:
            raise TaskError(f"seconds = {self.seconds}, duration = {self.duration}: expected 0 < seconds <= duration")
        if any(symbol.numel() != 1 for symbol in self.system.named.values()):
            raise TaskError("parameters of the system: expected numbers, one symbol each")
        if self.coordinates and n not in (len(self.coordinates), 2 * len(self.coordinates)):
            raise TaskError(f"coordinates = {self.coordinates}: expected names of {n} or half as many components")
        self.parameters_at({}, self.commands(np.random.default_rng(0))(0.0))

    @cached_property
    def tick(self) -> Tick:
        """The controller's tick. `look` gives `observation`, and `barriers` in their order."""
        reads = {
            "observation": ca.vertcat(*self.observed.values()),
            "barriers": ca.vertcat(*(b.B for b in self.barriers)),
        }
        return Tick(self.system, self.quantities, limit=self.limit, objective=self.objective, reads=reads)

    @property
    def barriers(self) -> list[Barrier]:
        """In their order."""
        return [each for each in self.quantities if isinstance(each, Barrier)]

    @property
    def observed(self) -> Mapping[str, ca.SX]:
        """What a policy reads, by name."""
        if self.observation is not None:
            return self.observation
        x = self.system.x
        named = list(self.coordinates) + [f"d{each}" for each in self.coordinates]
        return {named[i] if i < len(named) else f"x{i + 1}": x[i] for i in range(x.numel())}

    @property
    def names_of_q(self) -> tuple[str, ...]:
        """Of the coordinates."""
        return self.coordinates or tuple(f"x{i + 1}" for i in range(self.system.x.numel()))

    @property
    def names_of_u(self) -> tuple[str, ...]:
        """Of the inputs."""
        return self.inputs or tuple(f"u{i + 1}" for i in range(self.system.u.numel()))

    @property
    def commanded(self) -> tuple[str, ...]:
        """The parameters that `commands` gives."""
        return tuple(name for name in self.system.named if name not in self.nominal)

    def parameters_at(self, of_plant: Mapping[str, float], commanded: Mapping[str, float]) -> Array:
        """p (k,) of the model, with what is `commanded` and what is `of_plant`; raises `TaskError`."""
        if set(commanded) != set(self.commanded):
            given, wanted = ", ".join(sorted(commanded)) or "nothing", ", ".join(self.commanded) or "nothing"
            raise TaskError(f"commands give {given}: expected {wanted}")
        values = {**self.nominal, **of_plant, **commanded}
        p = np.array([values[name] for name in self.system.named])
        if not np.isfinite(p).all():
            raise TaskError(f"commands = {dict(commanded)}: expected finite numbers")
        return p

    @cached_property
    def _later(self) -> NumpyFunction:
        """The state after a substep of a held input, by Runge and Kutta's method of order 4."""
        system, steps = self.system, self.substeps
        h = self.seconds / steps
        slope = ca.Function("slope", [system.x, system.p, system.u], [system.x_dot])
        k1 = slope(system.x, system.p, system.u)
        k2 = slope(system.x + h / 2 * k1, system.p, system.u)
        k3 = slope(system.x + h / 2 * k2, system.p, system.u)
        k4 = slope(system.x + h * k3, system.p, system.u)
        later = system.x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return NumpyFunction.of("later", {"x": system.x, "p": system.p, "u": system.u}, {"x": later})

    @property
    def substeps(self) -> int:
        """Of the plant in a tick."""
        return max(1, math.ceil(self.seconds / SUBSTEP - 1e-9))

    def moved(self, x: Array, p: Array, u: Array) -> Array:
        """The true state after a tick of the input `u` under the plant's parameters `p`."""
        if self.plant:
            return np.asarray(self.plant(x, p, u), dtype=float)
        for _ in range(self.substeps):
            x = self._later(x, p, u).x
        return x

    @cached_property
    def _has_failed(self) -> NumpyFunction:
        value = ca.SX(-1) if self.failed is None else self.failed
        return NumpyFunction.of("failed", {"x": self.system.x, "p": self.system.p}, {"value": value})

    def has_failed(self, x: Array, p: Array) -> bool:
        """Whether an episode ends here, badly."""
        return not np.isfinite(x).all() or bool(self._has_failed(x, p).value[0] > 0)


def load_task(source: str) -> ControlTask:
    """The only ControlTask of a Python file, or the one that an installed package brings under this name.

    A file is code, and runs. Raises `TaskError`.
    """
    if not source.endswith(".py"):
        try:
            found = plugins.load(GROUP, source)
        except LookupError as error:
            raise TaskError(f"{error}; or a file that ends in .py") from error
        return _checked(found, source)
    path = Path(source)
    if not path.is_file():
        raise TaskError(f"{source}: no such file")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    tasks = [value for value in vars(module).values() if isinstance(value, ControlTask)]
    if len(tasks) != 1:
        raise TaskError(f"{source}: {len(tasks)} objects of ControlTask; expected one")
    return tasks[0]


def _checked(found: Any, source: str) -> ControlTask:
    if not isinstance(found, ControlTask):
        raise TaskError(f"{GROUP} {source}: expected a ControlTask, found {found!r}")
    return found
