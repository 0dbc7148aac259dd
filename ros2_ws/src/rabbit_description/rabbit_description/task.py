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

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.constraints import Barrier
from cbf_clf_qp.functions import Array, NumpyFunction
from cbf_clf_qp.quantity import Constrained, Rows, Terms
from cbf_clf_qp.system import System
from cbf_clf_qp.tick import Tick
from scipy.optimize import brentq

from rabbit_description.validation import one_of

SUBSTEP = 0.001  # s, of the plant's integration, at most
EVENT_TOLERANCE = 1e-13  # s, of an impact
Commands = Callable[[float], Mapping[str, float]]
Announced = Callable[[int], Mapping[str, float]]
Given = Callable[[float, int], Mapping[str, float]]  # both, of the time, s, and the number of impacts
OwnController = Callable[[Array, Array], Array]


class TaskError(ValueError):
    """A task whose parts do not fit together, or a file without one; the message is one line."""


@dataclass(frozen=True)
class Line:
    """A line in a picture: through `points` (k, 2), m, as wide as so many points of a page."""

    points: Array
    colour: str = "black"
    width: float = 3.0


@dataclass(frozen=True)
class Disc:
    """A disc in a picture: around `centre` (2,), m, of a radius, m."""

    centre: Array
    radius: float
    colour: str = "tab:red"


Shape = Line | Disc


@dataclass(frozen=True, eq=False)
class Impact:
    """A jump: `guard`, `armed` and `after` (n,), expressions of x and p.

    Where `guard` falls through zero while `armed` is positive, the state becomes `after`, and the input that the tick
    holds becomes `held` (m,), of u, where the jump exchanges inputs, as legs that swap.
    """

    guard: ca.SX
    after: ca.SX
    armed: ca.SX | float = 1.0
    held: ca.SX | None = None


class Limit(NamedTuple):
    """An episode has failed where `value`, of x, p and u, is less than `least` or more than `most`, all in `unit`."""

    value: ca.SX
    least: float = -math.inf
    most: float = math.inf
    unit: str = ""

    def said(self, name: str, value: float) -> str:
        """Which bound was passed, and how far."""
        bound = f"at most {self.most:g}" if value > self.most else f"at least {self.least:g}"
        return f"{name} = {value:.4g}: expected {bound} {self.unit}".strip()


class Moved(NamedTuple):
    """The state x (n,) after a tick, the input u (m,) that it holds by then, and how many impacts there were."""

    x: Array
    u: Array
    impacts: int


@dataclass(frozen=True, eq=False)
class ControlTask:
    """A system with all that a run of it needs.

    Args:
        name: of the task; a policy that was trained for it bears it.
        system: its state x is (q, q') if it has two components for each of `coordinates`, else q alone.
        quantities: CLF and barriers, see `cbf_clf_qp.constraints`.
        nominal: the parameters that the model has, by name; `true`: those of the plant that differ.
        start: the least and the greatest first state (n,); each episode draws one.
        commands: of an episode's random generator: a function of time (s) that gives the other parameters.
        announce: likewise a function of the number of impacts, for what changes with each, as the next stone's edges.
        limit: of |u|, each component.
        seconds, duration: of a tick and of an episode.
        observation: what a policy reads, by name; None: the state.
        failed: positive where an episode has failed, an expression of x, p and the input u that is held there, or a
            `Limit` by its name, or several; it is looked at as a tick ends, but not one with an impact, in which forces
            are the impact's.
        tolerance: by how much a barrier may be negative and still counts as kept, in the barrier's unit.
        constraints: further rows, under the model, see `Tick`: nothing of them is learned.
        objective: see `Tick`; None: the least mu.
        coordinates: names of q; none: x1, x2, ... inputs: names of u; none: u1, u2, ...
        draw: shapes in the plane for a state x and parameters p (a mapping by name); None: the state in the
            plane of its first two components.
        controllers: further ones by name, u (m,) of (x, p): end to end, without a QP.
        plant: the next state of (x, p, u) in place of an integration of the system.
        impact: where the state jumps; impacts: an episode is done after so many, and has failed if it has fewer.
        training: what a training of it has in place of the defaults, by name, see `TrainingParameters`.

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
    announce: Callable[[np.random.Generator], Announced] = field(default=lambda rng: lambda impacts: {})
    limit: float | None = None
    seconds: float = 0.01
    duration: float = 5.0
    observation: Mapping[str, ca.SX] | None = None
    failed: ca.SX | Mapping[str, Limit] | None = None
    tolerance: float = 0.01
    constraints: Sequence[Callable[[Terms], list[Rows]]] = ()
    objective: Callable[[Terms], Affine | None] | None = None
    coordinates: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    draw: Callable[[Array, Mapping[str, float]], Sequence[Shape]] | None = None
    controllers: Mapping[str, OwnController] = field(default_factory=dict)
    plant: Callable[[Array, Array, Array], Array] | None = None
    impact: Impact | None = None
    impacts: int | None = None
    training: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = self.system.x.numel()
        for name, values, known in (("nominal", self.nominal, self.system.named), ("true", self.true, self.nominal)):
            if strange := sorted(set(values) - set(known)):
                raise TaskError(f"{name} = {', '.join(strange)}: expected {one_of(strange[0], known)}")
            if wrong := [f"{key} = {value}" for key, value in values.items() if not math.isfinite(value)]:
                raise TaskError(f"{name}: {', '.join(wrong)}: expected finite numbers")
        if [len(bound) for bound in self.start] != [n, n] or not all(
            -math.inf < least <= most < math.inf for least, most in zip(*self.start, strict=True)
        ):
            raise TaskError(f"start = {self.start}: expected the least and the greatest state, {n} finite numbers each")
        if self.limit is not None and not (isinstance(self.limit, int | float) and 0 <= self.limit < math.inf):
            raise TaskError(f"limit = {self.limit}: expected a number from 0 on, which holds for each input")
        if not 0 < self.seconds <= self.duration < math.inf:
            raise TaskError(f"seconds = {self.seconds}, duration = {self.duration}: expected 0 < seconds <= duration")
        if any(symbol.numel() != 1 for symbol in self.system.named.values()):
            raise TaskError("parameters of the system: expected numbers, one symbol each")
        if self.coordinates and n not in (len(self.coordinates), 2 * len(self.coordinates)):
            raise TaskError(f"coordinates = {self.coordinates}: expected names of {n} or half as many components")
        if self.inputs and len(self.inputs) != self.system.u.numel():
            raise TaskError(f"inputs = {self.inputs}: expected names of {self.system.u.numel()} components")
        for name, names in (("coordinates", self.coordinates), ("inputs", self.inputs)):
            if len(set(names)) < len(names):
                raise TaskError(f"{name} = {names}: expected names that differ")
        for name, of in (("after", self.system.x), ("held", self.system.u)):
            jump = getattr(self.impact, name, None)
            if jump is not None and jump.shape != of.shape:
                raise TaskError(f"impact: {name} has {jump.numel()} components; expected {of.numel()}")
        if self.impacts is not None and (self.impact is None or self.impacts < 1):
            raise TaskError(f"impacts = {self.impacts}: expected 1 or more, and an impact")
        self.parameters_at({}, self.beginning(0)[1](0.0, 0))

    @cached_property
    def tick(self) -> Tick:
        """The controller's tick. `look` gives `observation`, and `barriers` in their order."""
        barriers = ca.vertcat(*(barrier.B for barrier in self.barriers))
        reads = {"observation": ca.vertcat(*self.observed.values()), "barriers": barriers}
        return Tick(
            self.system,
            self.quantities,
            limit=self.limit,
            constraints=self.constraints,
            objective=self.objective,
            reads=reads,
        )

    @property
    def barriers(self) -> list[Barrier]:
        """The barriers in their order."""
        return [quantity for quantity in self.quantities if isinstance(quantity, Barrier)]

    @property
    def observed(self) -> Mapping[str, ca.SX]:
        """What a policy reads, by name."""
        if self.observation is not None:
            return self.observation
        return dict(zip(self.names_of_x, ca.vertsplit(self.system.x), strict=True))

    @property
    def names_of_x(self) -> tuple[str, ...]:
        """The names of the state's components."""
        named = [*self.coordinates, *(f"d{name}" for name in self.coordinates)]
        return tuple(named[i] if i < len(named) else f"x{i + 1}" for i in range(self.system.x.numel()))

    @property
    def names_of_q(self) -> tuple[str, ...]:
        """The names of the coordinates."""
        return self.coordinates or tuple(f"x{i + 1}" for i in range(self.system.x.numel()))

    @property
    def names_of_u(self) -> tuple[str, ...]:
        """The names of the inputs."""
        return self.inputs or tuple(f"u{i + 1}" for i in range(self.system.u.numel()))

    def beginning(self, seed: int) -> tuple[Array, Given, np.random.Generator]:
        """How an episode begins: the first state x (n,), other parameters, and exploration's generator."""
        course, exploring = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
        x = course.uniform(*np.asarray(self.start, dtype=float))
        commanded, announced = self.commands(course), self.announce(course)
        return x, lambda seconds, impacts: {**commanded(seconds), **announced(impacts)}, exploring

    @property
    def commanded(self) -> tuple[str, ...]:
        """The parameters that `commands` and `announce` give."""
        return tuple(name for name in self.system.named if name not in self.nominal)

    def parameters_at(self, of_plant: Mapping[str, float], commanded: Mapping[str, float]) -> Array:
        """p (k,) of the model, with what is `commanded` and what is `of_plant`; raises `TaskError`."""
        if set(commanded) != set(self.commanded):
            names, expected = ", ".join(sorted(commanded)) or "nothing", ", ".join(self.commanded) or "nothing"
            raise TaskError(f"commands give {names}: expected {expected}")
        values = {**self.nominal, **of_plant, **commanded}
        try:
            p = np.array([float(values[name]) for name in self.system.named])
        except (TypeError, ValueError):
            p = np.array(math.nan)
        if not np.isfinite(p).all():
            raise TaskError(f"commands = {dict(commanded)}: expected finite numbers")
        return p

    @cached_property
    def later_by(self) -> NumpyFunction:
        """The state h seconds later under a held input, by Runge and Kutta's method of order 4."""
        system, h = self.system, ca.SX.sym("h")
        slope = ca.Function("slope", [system.x, system.p, system.u], [system.x_dot])
        k1 = slope(system.x, system.p, system.u)
        k2 = slope(system.x + h / 2 * k1, system.p, system.u)
        k3 = slope(system.x + h / 2 * k2, system.p, system.u)
        k4 = slope(system.x + h * k3, system.p, system.u)
        later = system.x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return NumpyFunction.of("later", {"x": system.x, "p": system.p, "u": system.u, "h": h}, {"x": later})

    @cached_property
    def _strike(self) -> tuple[NumpyFunction, NumpyFunction]:
        """`guard` and `armed` of x and p; `x` and `u` after the impact, of x, p and u."""
        assert self.impact
        system, inputs = self.system, {"x": self.system.x, "p": self.system.p}
        when = {"guard": self.impact.guard, "armed": ca.SX(self.impact.armed)}
        held = system.u if self.impact.held is None else self.impact.held
        after = NumpyFunction.of("after", {**inputs, "u": system.u}, {"x": self.impact.after, "u": held})
        return NumpyFunction.of("when", inputs, when), after

    @property
    def ticks(self) -> int:
        """The most ticks of an episode."""
        return round(self.duration / self.seconds)

    @property
    def substeps(self) -> int:
        """The plant's substeps in a tick."""
        return max(1, math.ceil(self.seconds / SUBSTEP - 1e-9))

    @cached_property
    def glide(self) -> NumpyFunction:
        """`x` after a tick of (x, p, u) without an impact, and whether the state `strikes` in it."""
        system = self.system
        x, p, u = (ca.MX.sym(name, getattr(system, name).numel()) for name in "xpu")
        now, strikes = x, ca.MX(0)
        for _ in range(self.substeps):
            then = self.later_by.function(now, p, u, self.seconds / self.substeps)
            if self.impact:
                before, end = (self._strike[0].function(state, p) for state in (now, then))
                falls = ca.logic_and(before[0] > 0, ca.logic_and(end[0] <= 0, end[1] > 0))
                strikes = ca.logic_or(strikes, falls)
            now = then
        function = ca.Function("glide", [x, p, u], [ca.vertcat(now, strikes)], ["x", "p", "u"], ["values"])
        n = x.numel()
        return NumpyFunction(function, {"x": (slice(n), (n,)), "strikes": (slice(n, n + 1), (1,))})

    def moved(self, x: Array, p: Array, u: Array) -> Moved:
        """The true state after a tick of the input `u` under the plant's parameters `p`."""
        if self.plant:
            return Moved(np.asarray(self.plant(x, p, u), dtype=float), u, 0)
        if not (glided := self.glide(x, p, u)).strikes[0]:
            return Moved(glided.x, u, 0)
        now, h = Moved(x, u, 0), self.seconds / self.substeps
        for _ in range(self.substeps):
            now = self._substep(now, p, h)
        return now

    def _substep(self, now: Moved, p: Array, h: float) -> Moved:
        """Through an impact too, which is located."""

        def later(seconds: float, since: Moved = now) -> Array:
            return self.later_by(since.x, p, since.u, np.array([seconds])).x

        x = later(h)
        if self.impact is None or not np.isfinite(x).all():
            return now._replace(x=x)
        when, after = self._strike
        end = when(x, p)
        if not (when(now.x, p).guard[0] > 0 >= end.guard[0] and end.armed[0] > 0):
            return now._replace(x=x)
        until = brentq(lambda seconds: when(later(seconds), p).guard[0], 0, h, xtol=EVENT_TOLERANCE)
        struck = after(later(until), p, now.u)
        now = Moved(struck.x, struck.u, now.impacts + 1)
        return now._replace(x=later(h - until, now))

    @property
    def limits(self) -> Mapping[str, Limit]:
        """Beyond which an episode has failed."""
        if isinstance(self.failed, Mapping):
            return self.failed
        return {} if self.failed is None else {"failed": Limit(self.failed, most=0.0)}

    @cached_property
    def _limited(self) -> NumpyFunction:
        """The values of all limits, and by how much they are passed."""
        system, limits = self.system, self.limits.values()
        beyond = [ca.fmax(limit.value - limit.most, limit.least - limit.value) for limit in limits]
        columns = {"values": [limit.value for limit in limits], "beyond": beyond}
        outputs = {name: ca.vertcat(ca.SX(0, 1), *column) for name, column in columns.items()}
        return NumpyFunction.of("limited", {"x": system.x, "p": system.p, "u": system.u}, outputs)

    def why_failed(self, now: Moved, p: Array, impacts: int) -> str:
        """Why an episode with this outcome failed: which limit was passed, its value and the bound."""
        if not np.isfinite(now.x).all():
            return f"state = {now.x.tolist()}: expected finite numbers"
        limited = self._limited(now.x, p, now.u)
        for (name, limit), value, beyond in zip(self.limits.items(), limited.values, limited.beyond, strict=True):
            if beyond > 0 and not now.impacts:
                return limit.said(name, float(value))
        return f"impacts = {impacts}: expected {self.impacts} in {self.duration:g} s"

    def keeps(self, outcome: str, margins: Array) -> bool:
        """Whether an episode ended well, and no barrier's least value, of `margins`, was below its tolerance."""
        return outcome == "done" and bool((margins >= -self.tolerance).all())

    def outcome(self, now: Moved, p: Array, ticks: int, impacts: int) -> str:
        """How an episode ends after so many ticks and impacts: failed, done, or not yet, which is empty."""
        is_beyond = not now.impacts and bool((self._limited(now.x, p, now.u).beyond > 0).any())
        if is_beyond or not np.isfinite(now.x).all():
            return "failed"
        if self.impacts is None:
            return "done" if ticks >= self.ticks else ""
        return "done" if impacts >= self.impacts else "failed" if ticks >= self.ticks else ""
