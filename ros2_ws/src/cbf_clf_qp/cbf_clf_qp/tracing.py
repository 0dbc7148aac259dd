"""Functions of arrays that CasADi evaluates, after one run with its symbols in place of the numbers.

    def scaled(box, factor):                     # any Python of numpy arrays that does not branch on their values
        return (box.corners * factor,)

    fast = Traced(scaled)
    (corners,) = fast(box, 2.0)                  # the first call traces, the later ones take microseconds

An operation on a small array costs numpy a microsecond, and a tick has hundreds. The trace has the same operations, so
the results are the same but for rounding. What cannot be traced is computed by numpy as before: a function that
branches on a value, an argument of an unknown class, a machine without CasADi. `Traced.reason` says why. With
CBF_CLF_QP_TRACING=off in the environment numpy computes everything: so a debugger stops in your rows at every tick.

Arguments and results are dataclasses, tuples, arrays and numbers; a part of a result that is a part of an argument is
that object itself. The function must depend on nothing else that changes. All numbers of a call's results lie in one
row, which a dataclass among them knows: as an argument of another trace it costs one copy of the row, not one of each
array.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from types import SimpleNamespace
from typing import Any

import numpy as np

from cbf_clf_qp.symbols import Array, Symbol, Untraceable, ca, is_symbolic, new_symbols, to_casadi

TOLERANCE = 1e-9  # by which trace and function may differ, relative to the largest number of all results
ENABLED = ca is not None and os.environ.get("CBF_CLF_QP_TRACING") != "off"
CONSTANTS = (type(None), bool, str, Enum)
MISFITS = (AttributeError, IndexError, TypeError, ValueError)  # of a trace to arguments
MOST_TRACES = 8

ROW = "_traced_row"  # attribute of a result: the row that its numbers lie in, and where
NO_ROW = (None, None)

Path = tuple[Any, ...]  # an argument's number, then attributes and indices
Places = dict[Path, slice]  # where in a row of numbers the parts of a result lie
Function = Callable[..., Sequence[Any]]
Evaluation = Callable[[tuple[Any, ...]], Sequence[Any]]


class Traced:
    """A `function` that returns a list of arrays, dataclasses of them, and things that are the same at every call.

    There is a trace for each structure of the arguments: what of them is None, a word, how long the tuples are. So the
    digits do not depend on what was computed before. One object serves one thread; `twin` makes another with the same
    traces.
    """

    def __init__(self, function: Function) -> None:
        self._function = function
        self._traces: list[_Trace] = []  # of this and its twins
        self._evaluation: Evaluation | None = None
        self.reason = "" if ENABLED else "CasADi is not installed, or CBF_CLF_QP_TRACING=off"

    def twin(self) -> "Traced":
        """The same function, for another thread."""
        twin = Traced(self._function)
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


@dataclass(frozen=True)
class _Trace:
    """CasADi's `function` of one row of numbers, and the Python `code` that fills the row and makes the results.

    The code knows the objects in `names`; its row of results has these `fields`.
    """

    function: Any
    code: Any
    names: dict[str, Any]
    fields: np.dtype[Any]

    @classmethod
    def of(cls, function: Function, arguments: tuple[Any, ...]) -> "_Trace":
        copier = _Copier()
        outcome = function(*(copier.symbolic((i,), value) for i, value in enumerate(arguments)))
        writer = _Writer(copier.copies)
        results = [writer.result((i,), value) for i, value in enumerate(outcome)]
        row = to_casadi(np.concatenate([array.ravel() for array in writer.arrays]))
        read = {symbol.name() for symbol in ca.symvar(row)}
        inputs = [(path, array) for path, array in copier.symbols if any(s.sx.name() in read for s in array.ravel())]
        given = [array for _, array in inputs] + [symbols for symbols, _ in copier.rows.values()]
        flat = to_casadi(np.concatenate([array.ravel() for array in given or [new_symbols("none", (1,))]]))
        lines = [*writer.checks(len(arguments), copier), *writer.filling(inputs, copier.rows.values()), *writer.lines]
        lines += [f"return [{', '.join(results)}]"]
        source = "\n    ".join(["def evaluate(arguments):", *lines])
        return cls(
            ca.Function("traced", [flat], [row], {"cse": True}),
            compile(source, f"<trace of {function.__qualname__}>", "exec"),
            writer.names,
            np.dtype([(str(i), float, array.shape) for i, array in enumerate(writer.arrays)]),
        )

    def evaluation(self) -> Evaluation:
        """A call, with memory of its own for the numbers."""
        given, found = np.zeros(self.function.numel_in()), np.zeros(self.function.numel_out())
        buffer, run = self.function.buffer()
        buffer.set_arg(0, given.data)
        buffer.set_res(0, found.data)
        names = {**self.names, "given": given, "found": found, "run": run, "fields": self.fields, "kept": buffer}
        exec(self.code, names)  # as the methods of a dataclass are made
        evaluate: Evaluation = names["evaluate"]
        return evaluate


class _Writer:
    """Writes the Python of a call: checks, the row of numbers to fill, the results; notes the symbols of these.

    Generic code that walks the same paths at every call takes three times as long.
    """

    def __init__(self, copies: dict[int, tuple[Path, Any]]) -> None:
        self._copies = copies
        self.arrays: list[Array] = []
        self._places: dict[int, Places] = {}
        self._size = 0
        self.names: dict[str, Any] = {
            **{"ROW": ROW, "NO_ROW": NO_ROW, "Untraceable": Untraceable, "ndarray": np.ndarray},
            **{"new": object.__new__, "put": object.__setattr__},
        }
        self.lines = ["run()", "numbers = found.copy()", "row = ndarray((), fields, numbers)"]

    def checks(self, count: int, copier: "_Copier") -> Iterator[str]:
        """What has to be as in the call that was traced."""
        yield f"if len(arguments) != {count}: raise Untraceable('expected {count} arguments')"
        for path, value in copier.constants:
            yield f"if {at(path)} != {self._name(value)}: raise Untraceable('a word has changed')"
        for path, length in copier.lengths:
            yield f"if len({at(path)}) != {length}: raise Untraceable('expected {length} parts')"

    def filling(
        self, inputs: list[tuple[Path, Array]], rows: Iterable[tuple[Array, list[tuple[int, Places]]]]
    ) -> Iterator[str]:
        """The row of numbers, from inputs and then from rows of other traces, each by the results that lie in it."""
        start = 0
        for path, array in inputs:
            end, is_wrong = start + array.size, f"value.shape != {array.shape}" if array.shape else "value is None"
            yield f"value = {at(path)}"
            yield f"if {is_wrong}: raise Untraceable('expected another shape')"
            taken = ".ravel()" if len(array.shape) > 1 else ""
            yield f"given[{start}:{end}] = value{taken}" if array.shape else f"given[{start}] = value"
            start = end
        for symbols, users in rows:
            for i, (number, places) in enumerate(users):
                own = "row" if i == 0 else "other"
                yield f"{own}, places = {at((number,))}.__dict__.get(ROW, NO_ROW)"
                is_wrong = f"places is not {self._name(places)}" + (" or other is not row" if i else "")
                yield f"if {is_wrong}: raise Untraceable('expected results of one call of another trace')"
            yield f"given[{start}:{start + symbols.size}] = row"
            start += symbols.size

    def result(self, path: Path, value: Any) -> str:
        """An expression for the part of all results at a path."""
        if id(value) in self._copies:
            return at(self._copies[id(value)][0])
        if isinstance(value, np.ndarray):
            return self._field(path, value)
        if isinstance(value, Symbol):
            return self._field(path, np.array(value, dtype=object)) + ".item()"
        if not _has_symbols(value):
            return self._name(value)
        parts = {key: self.result((*path, key), part) for key, part in _parts(value)}
        if isinstance(value, tuple | list):
            return f"{self._name(type(value))}([{', '.join(parts.values())}])"
        items = [f"{key!r}: {part}" for key, part in parts.items()]
        if len(path) == 1 and path[0] in self._places:
            items.append(f"ROW: (numbers, {self._name(self._places[path[0]])})")
        made = f"made_{len(self.lines)}"
        self.lines.append(f"{made} = new({self._name(type(value))})")
        self.lines.append(f"put({made}, '__dict__', {{{', '.join(items)}}})")
        return made

    def _field(self, path: Path, array: Array) -> str:
        self._places.setdefault(path[0], {})[path[1:]] = slice(self._size, self._size + array.size)
        self._size += array.size
        self.arrays.append(array)
        return f"row['{len(self.arrays) - 1}']"

    def _name(self, value: Any) -> str:
        name = f"known_{len(self.names)}"
        self.names[name] = value
        return name


def at(path: Path) -> str:
    """The Python for what lies at a path of the arguments."""
    return "arguments" + "".join(f".{key}" if isinstance(key, str) else f"[{key}]" for key in path)


class _Copier:
    """Copies arguments with symbols for all their numbers; notes where these are, and what else there is."""

    def __init__(self) -> None:
        self.symbols: list[tuple[Path, Array]] = []
        self.rows: dict[int, tuple[Array, list[tuple[int, Places]]]] = {}  # of other traces, by identity
        self.constants: list[tuple[Path, Any]] = []
        self.lengths: list[tuple[Path, int]] = []
        self.copies: dict[int, tuple[Path, Any]] = {}  # by identity

    def symbolic(self, path: Path, value: Any, row: tuple[Array, Places] | None = None) -> Any:
        """The copy of what lies at a path; `row`: the symbols of the other trace that its first part came from."""
        if isinstance(value, CONSTANTS):
            self.constants.append((path, value))
            return value
        if len(path) == 1 and ROW in getattr(value, "__dict__", ()):
            row = self._row(path[0], *value.__dict__[ROW])
        copy = self._copy(path, value, row)
        self.copies[id(copy)] = path, copy
        return copy

    def _row(self, number: int, numbers: Array, places: Places) -> tuple[Array, Places]:
        if id(numbers) not in self.rows:
            self.rows[id(numbers)] = new_symbols(f"r{len(self.rows)}", numbers.shape), []
        symbols, users = self.rows[id(numbers)]
        users.append((number, places))
        return symbols, places

    def _copy(self, path: Path, value: Any, row: tuple[Array, Places] | None) -> Any:
        if isinstance(value, np.ndarray | np.number | int | float):
            if row is not None and path[1:] in row[1]:
                array = row[0][row[1][path[1:]]].reshape(np.shape(value))
            else:
                array = new_symbols(f"s{len(self.symbols)}", np.shape(value))
                self.symbols.append((path, array))
            return array if isinstance(value, np.ndarray) else array[()]
        copies = {key: self.symbolic((*path, key), part, row) for key, part in _parts(value)}
        if isinstance(value, tuple | list):
            self.lengths.append((path, len(value)))
            return type(value)(copies.values())
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
        yield from ((field.name, getattr(value, field.name)) for field in fields(value))
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
    if isinstance(value, np.ndarray | np.number | int | float) and not isinstance(value, bool):
        yield np.asarray(value)
        return
    try:
        parts = [part for _, part in _parts(value)]
    except Untraceable:
        yield value
        return
    for part in parts:
        yield from _leaves(part)
