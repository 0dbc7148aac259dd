"""Functions of arrays that CasADi evaluates, after one run with its symbols in place of the numbers.

    def scaled(box, factor):                     # any Python of numpy arrays that does not branch on their values
        return (box.corners * factor,)

    fast = Traced(scaled)                        # `box` of a class in a package that TRUSTED names
    (corners,) = fast(box, 2.0)                  # the first call traces, the later ones take microseconds

An operation on a small array costs numpy a microsecond, and a tick has hundreds. The trace has the same operations, so
the results are the same but for rounding. What cannot be traced is computed by numpy as before: a function that
branches on a value, an argument of an unknown class, a machine without CasADi. `Traced.reason` says why. A trace keeps
what the function reads besides its arguments: an attribute of `self`, a global. So only classes of the packages in
`TRUSTED` are traced, whose objects stay as they were made; another package's code runs at every call. With
CBF_CLF_QP_TRACING=off in the environment numpy computes everything: so a debugger stops in your rows at every tick.

Arguments and results are dataclasses, tuples, arrays and numbers; a part of a result that is a part of an argument is
that object itself. The function must depend on nothing else that changes. All numbers of a call's results lie in one
row. What a dataclass holds besides arrays is made when it is first read. A trace that has such a dataclass as an
argument copies its whole row.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from cbf_clf_qp.symbols import Array, Symbol, Untraceable, ca, is_symbolic, new_symbols, to_casadi

TOLERANCE = 1e-9  # by which trace and function may differ, relative to the largest number of all results
ENABLED = ca is not None and os.environ.get("CBF_CLF_QP_TRACING") != "off"
CONSTANTS = (type(None), bool, str, Enum)
NUMBERS = (np.ndarray, np.number, int, float)
MISFITS = (AttributeError, IndexError, TypeError, ValueError)  # of a trace to arguments
MOST_TRACES = 8
TRUSTED = {"cbf_clf_qp"}  # packages add themselves

CALL = "_traced_call"  # attribute of a result: the call that it is of
PLACES = "_traced_places"  # attribute of its class: where in the row of that call its numbers lie

Path = tuple[Any, ...]  # an argument's number, then attributes and indices
Places = dict[Path, slice | None]  # where in a row of numbers the parts of a result lie; None: the same at every call
Call = tuple[Any, Array, tuple[Any, ...]]  # what one leaves: the row of results by name, its numbers, the arguments
Maker = Callable[[Call], Any]  # of a part of the results
Function = Callable[..., Sequence[Any]]
Evaluation = Callable[[tuple[Any, ...]], Sequence[Any]]


def as_it_is(function: Any) -> Any:
    """No trace is compiled."""
    return function


compiled = as_it_is  # set by who has compiled traces: gives a trace's function as machine code, if there is such


class Traced:
    """A `function` that returns a list of arrays, dataclasses of them, and things that are the same at every call.

    There is a trace for each structure of the arguments: what of them is None, a word, how long the tuples are. So the
    digits do not depend on what was computed before. One object serves one thread; `twin` makes another with the same
    traces.
    """

    def __init__(self, function: Function, of: Sequence[Any] = ()) -> None:
        """`of`: the objects whose methods the function calls, besides those of its arguments."""
        self._function, self._of = function, of
        self._traces: list[_Trace] = []  # of this and its twins
        self._evaluation: Evaluation | None = None
        self.reason = foreign(of) if ENABLED else "CasADi is not installed, or CBF_CLF_QP_TRACING=off"

    def twin(self) -> "Traced":
        """The same function, for another thread."""
        twin = Traced(self._function, self._of)
        twin._traces = self._traces
        return twin

    def __call__(self, *arguments: Any) -> Sequence[Any]:
        if self._evaluation is not None:
            try:
                return self._evaluation(arguments)
            except MISFITS:
                pass
        return self._first(arguments)

    def _first(self, arguments: tuple[Any, ...]) -> Sequence[Any]:
        """The first call with arguments of a structure."""
        results = self._function(*arguments)
        if self.reason:
            return results
        try:
            evaluation, traced = self._fitting(arguments)
            _compare(results, traced)
        except Exception as error:  # whatever somebody's function does with symbols
            self.reason, self._evaluation = f"{type(error).__name__}: {error}", None
            return results
        self._evaluation = evaluation
        return traced

    def _fitting(self, arguments: tuple[Any, ...]) -> "tuple[Evaluation, Sequence[Any]]":
        """The trace for these arguments, with its results; a new one where none fits."""
        for trace in self._traces:
            evaluation = trace.evaluation()
            try:
                return evaluation, evaluation(arguments)
            except MISFITS:
                continue
        if len(self._traces) == MOST_TRACES:
            raise Untraceable(f"arguments of more than {MOST_TRACES} structures")
        self._traces.append(_Trace.of(self._function, arguments))
        evaluation = self._traces[-1].evaluation()
        return evaluation, evaluation(arguments)


def foreign(value: Any) -> str:
    """Which class or function among the parts of a value is of a package that is not trusted; empty where none is."""
    if isinstance(value, (*CONSTANTS, *NUMBERS)):
        return ""
    if isinstance(value, tuple | list):
        return next(filter(None, map(foreign, value)), "")
    code = value if isinstance(value, type | FunctionType) else type(value)
    if code.__module__.partition(".")[0] not in TRUSTED:
        return f"{code.__module__}.{code.__qualname__} is not of a package that is traced"
    if isinstance(value, type):
        return ""
    cells = value.__closure__ or () if isinstance(value, FunctionType) else ()
    return foreign([*(cell.cell_contents for cell in cells), *getattr(value, "__dict__", {}).values()])


@dataclass(frozen=True)
class _Trace:
    """CasADi's `function` of one row of numbers, and the Python `code` that fills the row and makes the results.

    The code knows the objects in `names`; its row of numbers has these `views`, its row of results these `fields`.
    """

    function: Any
    code: Any
    names: dict[str, Any]
    views: dict[str, slice]
    fields: np.dtype[Any]

    @classmethod
    def of(cls, function: Function, arguments: tuple[Any, ...]) -> "_Trace":
        copier = _Copier()
        outcome = function(*(copier.symbolic((i,), value) for i, value in enumerate(arguments)))
        results = _Results(copier.copies)
        whole = [results.whole(i, value) for i, value in enumerate(outcome)]
        row = to_casadi(np.concatenate([array.ravel() for array in results.arrays]))
        read = {symbol.name() for symbol in ca.symvar(row)}
        inputs = [(path, array) for path, array in copier.symbols if any(s.sx.name() in read for s in array.ravel())]
        given = [array for _, array in inputs] + [symbols for symbols, _ in copier.rows.values()]
        flat = to_casadi(np.concatenate([array.ravel() for array in given or [new_symbols("none", (1,))]]))
        writer = _Writer()
        lines = [*writer.checks(len(arguments), copier), *writer.filling(inputs, copier.rows.values())]
        lines += ["run()", "numbers = found.copy()", "row = ndarray((), fields, numbers)"]
        lines += ["call = row, numbers, arguments", *writer.returned(whole)]
        return cls(
            ca.Function("traced", [flat], [row], {"cse": True}),
            compile("\n    ".join(["def evaluate(arguments):", *lines]), f"<trace of {function.__qualname__}>", "exec"),
            writer.names,
            writer.views,
            np.dtype([(str(i), float, array.shape) for i, array in enumerate(results.arrays)]),
        )

    def evaluation(self) -> Evaluation:
        """A call, with memory of its own for the numbers."""
        given, found = np.zeros(self.function.numel_in()), np.zeros(self.function.numel_out())
        buffer, run = compiled(self.function).buffer()
        buffer.set_arg(0, given.data)
        buffer.set_res(0, found.data)
        names = {**self.names, "given": given, "found": found, "run": run, "fields": self.fields, "kept": buffer}
        names |= {name: given[place] for name, place in self.views.items()}
        exec(self.code, names)  # as the methods of a dataclass are made
        evaluate: Evaluation = names["evaluate"]
        return evaluate


class _Writer:
    """Writes the Python of a call: checks, then the row of numbers to fill.

    Generic code that walks the same paths at every call takes three times as long.
    """

    def __init__(self) -> None:
        self.views: dict[str, slice] = {}
        self.names: dict[str, Any] = {"CALL": CALL, "Untraceable": Untraceable, "ndarray": np.ndarray}
        self.names |= {"new": object.__new__, "put": object.__setattr__, "number": np.number | int | float}

    def checks(self, count: int, copier: "_Copier") -> Iterator[str]:
        """What has to be as in the call that was traced."""
        yield f"if len(arguments) != {count}: raise Untraceable('expected {count} arguments')"
        for path, value in copier.constants:
            is_other = "is not" if value is None or isinstance(value, bool) else "!="
            yield f"if {at(path)} {is_other} {self._name(value)}: raise Untraceable('a word has changed')"
        for path, length in copier.lengths:
            yield f"if len({at(path)}) != {length}: raise Untraceable('expected {length} parts')"
        for path, kind in copier.classes:
            yield f"if {at(path)}.__class__ is not {self._name(kind)}: raise Untraceable('expected another class')"
        for path, array in copier.symbols:
            if array.shape:
                yield f"if {at(path)}.shape != {array.shape}: raise Untraceable('expected another shape')"
            else:
                is_no_number = f"isinstance({at(path)}, bool) or not isinstance({at(path)}, number)"
                yield f"if {is_no_number}: raise Untraceable('expected a number')"

    def filling(
        self, inputs: list[tuple[Path, Array]], rows: Iterable[tuple[Array, list[tuple[int, type]]]]
    ) -> Iterator[str]:
        """The row of numbers, from inputs and then from rows of other traces, each by the results that lie in it."""
        start = 0
        for path, array in inputs:
            end = start + array.size
            if array.shape:
                yield f"{self._view(start, end)}[...] = {at(path)}{'.ravel()' if len(array.shape) > 1 else ''}"
            else:
                yield f"given[{start}] = {at(path)}"
            start = end
        for symbols, users in rows:
            for i, (number, kind) in enumerate(users):
                own = "call" if i == 0 else "other"
                yield f"{own} = {at((number,))}.__dict__.get(CALL)"
                is_wrong = f"{at((number,))}.__class__ is not {self._name(kind)} or {own} is None"
                is_wrong += " or other is not call" if i else ""
                yield f"if {is_wrong}: raise Untraceable('expected results of one call of another trace')"
            yield f"{self._view(start, start + symbols.size)}[...] = call[1]"
            start += symbols.size

    def returned(self, results: list["Maker | _Made"]) -> Iterator[str]:
        """The results, each by its maker; of a dataclass the arrays at once."""
        made = []
        for i, result in enumerate(results):
            if isinstance(result, _Made):
                items = [f"{name!r}: row['{number}']" for name, number in result.arrays.items()]
                yield f"made_{i} = new({self._name(result.kind)})"
                yield f"put(made_{i}, '__dict__', {{CALL: call, {', '.join(items)}}})"
                made.append(f"made_{i}")
            else:
                made.append(f"{self._name(result)}(call)")
        yield f"return [{', '.join(made)}]"

    def _view(self, begin: int, end: int) -> str:
        name = f"given_{begin}"
        self.views[name] = slice(begin, end)
        return name

    def _name(self, value: Any) -> str:
        name = f"known_{len(self.names)}"
        self.names[name] = value
        return name


class _Results:
    """Finds the numbers of the results, `arrays` of symbols in the order of a row, and says how a part is made."""

    def __init__(self, copies: dict[int, tuple[Path, Any]]) -> None:
        self._copies = copies
        self.arrays: list[Array] = []
        self.numbers: dict[int, tuple[int, slice]] = {}  # of the arrays, by identity, and where in the row they lie
        self._places: dict[int, Places] = {}
        self._size = 0

    def whole(self, number: int, value: Any) -> "Maker | _Made":
        """The result of this number: a dataclass with its arrays, or what makes it."""
        make = self.maker((number,), value)
        if not isinstance(make, _Made):
            return make
        own = {str(name): self.numbers.get(id(part)) for name, part in _parts(value)}
        return replace(make, arrays={name: found[0] for name, found in own.items() if found})

    def maker(self, path: Path, value: Any) -> Maker:
        """Of the part of all results at a path."""
        if id(value) in self._copies:
            return _part_of_argument(self._copies[id(value)][0])
        if isinstance(value, np.ndarray):
            return self._array(path, value)
        if isinstance(value, Symbol):
            number = self._array(path, np.array(value, dtype=object))
            return lambda call: number(call).item()  # a float
        if not _has_symbols(value):
            self._places.setdefault(path[0], {})[path[1:]] = None
            return lambda call: value
        parts = {key: self.maker((*path, key), part) for key, part in _parts(value)}
        kind = type(value)
        if isinstance(value, tuple | list):
            return lambda call: kind([make(call) for make in parts.values()])
        if isinstance(value, SimpleNamespace):
            return lambda call: SimpleNamespace(**{str(key): make(call) for key, make in parts.items()})
        return _Made(_made_when_read(kind, parts, self._places.get(path[0], {}) if len(path) == 1 else {}))

    def _array(self, path: Path, array: Array) -> Maker:
        if id(array) not in self.numbers:
            self.numbers[id(array)] = len(self.arrays), slice(self._size, self._size + array.size)
            self._size += array.size
            self.arrays.append(array)
        number, place = self.numbers[id(array)]
        self._places.setdefault(path[0], {})[path[1:]] = place
        name = str(number)
        return lambda call: call[0][name]


@dataclass(frozen=True)
class _Made:
    """Makes a dataclass of a `kind` whose fields are made when they are read; `arrays`: but for these, by number."""

    kind: type
    arrays: dict[str, int] = field(default_factory=dict)

    def __call__(self, call: Call) -> Any:
        value: Any = object.__new__(self.kind)
        value.__dict__[CALL] = call
        return value


class _Field:
    """An attribute that is made of its call when it is first read."""

    def __init__(self, name: str, make: Maker) -> None:
        self._name, self._make = name, make

    def __get__(self, owner: Any, kind: Any = None) -> Any:
        if owner is None:
            return self
        value = owner.__dict__[self._name] = self._make(owner.__dict__[CALL])
        return value


def _made_when_read(kind: type, parts: dict[Any, Maker], places: Places) -> type:
    """A class of this `kind`, with what makes its fields; `places`: where in the row of its call these lie."""
    members: dict[str, Any] = {name: _Field(name, make) for name, make in parts.items()}
    members |= {PLACES: places, "__module__": kind.__module__, "__doc__": kind.__doc__}
    members["__reduce__"] = lambda self: (kind, tuple(getattr(self, name) for name in parts))
    return type(kind.__name__, (kind,), members)


def _part_of_argument(path: Path) -> Maker:
    """What lies at a path of the arguments."""
    first, *rest = path

    def make(call: Call) -> Any:
        value = call[2][first]
        for key in rest:
            value = getattr(value, key) if isinstance(key, str) else value[key]
        return value

    return make


def at(path: Path) -> str:
    """The Python for what lies at a path of the arguments."""
    return "arguments" + "".join(f".{key}" if isinstance(key, str) else f"[{key}]" for key in path)


class _Copier:
    """Copies arguments with symbols for all their numbers; notes where these are, and what else there is."""

    def __init__(self) -> None:
        self.symbols: list[tuple[Path, Array]] = []
        self.rows: dict[int, tuple[Array, list[tuple[int, type]]]] = {}  # of other traces, by identity
        self.constants: list[tuple[Path, Any]] = []
        self.lengths: list[tuple[Path, int]] = []
        self.classes: list[tuple[Path, type]] = []
        self.copies: dict[int, tuple[Path, Any]] = {}  # by identity

    def symbolic(self, path: Path, value: Any, row: tuple[Array, Places] | None = None) -> Any:
        """The copy of what lies at a path; `row`: the symbols of the other trace that its first part came from."""
        if row is not None and row[1].get(path[1:], ...) is None:
            return value
        if isinstance(value, CONSTANTS):
            self.constants.append((path, value))
            return value
        if len(path) == 1 and CALL in getattr(value, "__dict__", ()):
            row = self._row(path[0], value)
        copy = self._copy(path, value, row)
        self.copies[id(copy)] = path, copy
        return copy

    def _row(self, number: int, result: Any) -> tuple[Array, Places]:
        numbers = result.__dict__[CALL][1]
        if id(numbers) not in self.rows:
            self.rows[id(numbers)] = new_symbols(f"r{len(self.rows)}", numbers.shape), []
        symbols, users = self.rows[id(numbers)]
        users.append((number, type(result)))
        return symbols, getattr(result, PLACES)

    def _copy(self, path: Path, value: Any, row: tuple[Array, Places] | None) -> Any:
        if isinstance(value, NUMBERS):
            place = row[1].get(path[1:]) if row is not None else None
            if row is not None and place is not None:
                array = row[0][place].reshape(np.shape(value))
            else:
                array = new_symbols(f"s{len(self.symbols)}", np.shape(value))
                self.symbols.append((path, array))
            return array if isinstance(value, np.ndarray) else array[()]
        copies = {key: self.symbolic((*path, key), part, row) for key, part in _parts(value)}
        if isinstance(value, tuple | list):
            self.lengths.append((path, len(value)))
            return type(value)(copies.values())
        if row is None:  # with a row, its class is of one trace
            self.classes.append((path, type(value)))
        if is_dataclass(value) and (code := foreign(type(value))):
            raise Untraceable(code)
        copy = object.__new__(type(value))
        copy.__dict__.update(copies)
        return copy


def _has_symbols(value: Any) -> bool:
    """Whether any part of it is a symbol."""
    if isinstance(value, np.ndarray):
        return is_symbolic(value)
    try:
        return isinstance(value, Symbol) or any(_has_symbols(part) for _, part in _parts(value))
    except Untraceable:
        return False


def _parts(value: Any) -> Iterator[tuple[int | str, Any]]:
    """What a value is made of, by attribute or index."""
    if isinstance(value, tuple | list):
        yield from enumerate(value)
    elif isinstance(value, SimpleNamespace):
        yield from vars(value).items()
    elif is_dataclass(value) and not isinstance(value, type):
        yield from ((each.name, getattr(value, each.name)) for each in fields(value))
    else:
        raise Untraceable(f"argument of class {type(value).__name__}")


def _compare(results: Sequence[Any], traced: Sequence[Any]) -> None:
    """Raise `Untraceable` where a trace gives other results."""
    expected, found = list(_leaves(results)), list(_leaves(traced))
    if len(expected) != len(found):
        raise Untraceable("another number of results")
    arrays = [result for result in expected if isinstance(result, np.ndarray)]
    # a result that is 0 but for rounding is as inexact as the others are large
    scale = max((float(np.abs(each[np.isfinite(each)]).max(initial=0.0)) for each in arrays), default=0.0)
    for i, (result, own) in enumerate(zip(expected, found, strict=True)):
        if not isinstance(result, np.ndarray):
            if result is not own and result != own:
                raise Untraceable(f"result {i} is not the same at every call: {result}")
        elif np.shape(own) != result.shape or not np.allclose(
            own, result, TOLERANCE, TOLERANCE * scale, equal_nan=True
        ):
            raise Untraceable(f"result {i} by symbols {own}, by numbers {result}")


def _leaves(value: Any) -> Iterator[Any]:
    """All arrays of results, numbers being such without axes, and whatever else there is."""
    if isinstance(value, NUMBERS) and not isinstance(value, bool):
        yield np.asarray(value)
        return
    try:
        parts = [part for _, part in _parts(value)]
    except Untraceable:
        yield value
        return
    for part in parts:
        yield from _leaves(part)
