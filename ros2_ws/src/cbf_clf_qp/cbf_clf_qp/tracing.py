"""Functions of arrays that CasADi evaluates, after one run with its symbols in place of the numbers.

    def scaled(box, factor):                     # any Python of numpy arrays that does not branch on their values
        return (box.corners * factor,)

    fast = Traced(scaled)
    (corners,) = fast(box, 2.0)                  # the first call traces, the later ones take microseconds

An operation on a small array costs numpy a microsecond, and a tick has hundreds. The trace has the same operations, so
the results are the same but for rounding. What cannot be traced is computed by numpy as before: a function that
branches on a value, an argument of an unknown class, a machine without CasADi. `Traced.reason` says why. With
CBF_CLF_QP_TRACING=off in the environment numpy computes everything: so a debugger stops in your rows at every tick.

Arguments are dataclasses, tuples, arrays and numbers. The function must depend on nothing else that changes.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import reduce
from itertools import accumulate, pairwise
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

import numpy as np

from cbf_clf_qp.symbols import Array, Untraceable, ca, new_symbols, to_casadi

TOLERANCE = 1e-9  # by which trace and function may differ, relative to the largest number of all results
ENABLED = ca is not None and os.environ.get("CBF_CLF_QP_TRACING") != "off"
CONSTANTS = (type(None), bool, str, Enum)
MISFITS = (AttributeError, IndexError, TypeError, ValueError)  # of a trace to arguments
MOST_TRACES = 8

Path = tuple[Any, ...]  # an argument's number, then attributes and indices
Function = Callable[..., Sequence[Any]]


class Traced:
    """A `function` that returns arrays, and other things that are the same at every call.

    There is a trace for each structure of the arguments: what of them is None, a word, how long the tuples are. So the
    digits do not depend on what was computed before. One object serves one thread; `twin` makes another with the same
    traces.
    """

    def __init__(self, function: Function) -> None:
        self._function = function
        self._traces: list[_Trace] = []  # of this and its twins
        self._evaluation: _Evaluation | None = None
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

    def _fitting(self, arguments: tuple[Any, ...]) -> "tuple[_Evaluation, Sequence[Any]]":
        """The trace for these arguments, with its results; a new one where none fits."""
        for trace in self._traces:
            evaluation = _Evaluation(trace)
            try:
                return evaluation, evaluation(arguments)
            except MISFITS:
                continue
        if len(self._traces) == MOST_TRACES:
            raise Untraceable(f"arguments of more than {MOST_TRACES} structures")
        self._traces.append(_Trace.of(self._function, arguments))
        evaluation = _Evaluation(self._traces[-1])
        return evaluation, evaluation(arguments)


@dataclass(frozen=True)
class _Trace:
    """CasADi's `function` of one row of numbers, for calls with `count` arguments.

    `inputs`: where in the arguments these numbers are; `constants`: what else was there, and has to be; `lengths`: of
    the tuples; `results`: the shape of each, or what is returned as it is.
    """

    function: Any
    count: int
    inputs: list[tuple[Path, tuple[int, ...]]]
    constants: list[tuple[Path, Any]]
    lengths: list[tuple[Path, int]]
    results: list[tuple[tuple[int, ...] | None, Any]]

    @classmethod
    def of(cls, function: Function, arguments: tuple[Any, ...]) -> "_Trace":
        copier = _Copier()
        symbolic = [copier.symbolic((i,), value) for i, value in enumerate(arguments)]
        outcome = list(function(*symbolic))
        arrays = [value for value in outcome if isinstance(value, np.ndarray)]
        row = to_casadi(np.concatenate([array.ravel() for array in arrays]))
        read = {symbol.name() for symbol in ca.symvar(row)}
        inputs = [(path, array) for path, array in copier.symbols if any(s.sx.name() in read for s in array.ravel())]
        flat = to_casadi(np.concatenate([array.ravel() for _, array in inputs]))
        return cls(
            ca.Function("traced", [flat], [row], {"cse": True}),
            len(arguments),
            [(path, array.shape) for path, array in inputs],
            copier.constants,
            copier.lengths,
            [(value.shape, None) if isinstance(value, np.ndarray) else (None, value) for value in outcome],
        )


class _Evaluation:
    """A trace with memory of its own for the numbers."""

    def __init__(self, trace: _Trace) -> None:
        sizes = [int(np.prod(shape)) for _, shape in trace.inputs]
        numbers = np.zeros(sum(sizes))
        self._results = np.zeros(trace.function.numel_out())
        self._count = trace.count
        self._inputs = [
            (path[0], _getter(path[1:]), numbers[start:end].reshape(shape), shape)
            for (path, shape), (start, end) in zip(trace.inputs, pairwise(accumulate(sizes, initial=0)), strict=True)
        ]
        self._constants = [(path[0], _getter(path[1:]), value) for path, value in trace.constants]
        self._lengths = [(path[0], _getter(path[1:]), length) for path, length in trace.lengths]
        self._outcome, start = list[tuple[slice | None, tuple[int, ...], Any]](), 0
        for shape, value in trace.results:
            end = start + int(np.prod(shape or (0,)))
            self._outcome.append((None if shape is None else slice(start, end), shape or (), value))
            start = end
        self._buffer, self._evaluate = trace.function.buffer()
        self._buffer.set_arg(0, numbers.data)
        self._buffer.set_res(0, self._results.data)

    def __call__(self, arguments: tuple[Any, ...]) -> Sequence[Any]:
        if len(arguments) != self._count:
            raise Untraceable(f"expected {self._count} arguments")
        for number, get, value in self._constants:
            if get(arguments[number]) != value:
                raise Untraceable(f"{value} has changed")
        for number, get, length in self._lengths:
            if len(get(arguments[number])) != length:
                raise Untraceable(f"expected {length} parts")
        for number, get, place, shape in self._inputs:
            value = get(arguments[number])
            if value is None or (shape and value.shape != shape):
                raise Untraceable(f"{value}: expected shape {shape}")
            place[...] = value
        self._evaluate()
        found = self._results.copy()
        return [value if where is None else found[where].reshape(shape) for where, shape, value in self._outcome]


class _Copier:
    """Copies arguments with symbols for all their numbers; notes where these are, and what else there is."""

    def __init__(self) -> None:
        self.symbols: list[tuple[Path, Array]] = []
        self.constants: list[tuple[Path, Any]] = []
        self.lengths: list[tuple[Path, int]] = []

    def symbolic(self, path: Path, value: Any) -> Any:
        """The copy of what lies at a path."""
        if isinstance(value, np.ndarray | np.number | int | float) and not isinstance(value, bool):
            array = new_symbols(f"s{len(self.symbols)}", np.shape(value))
            self.symbols.append((path, array))
            return array if isinstance(value, np.ndarray) else array[()]
        if isinstance(value, CONSTANTS):
            self.constants.append((path, value))
            return value
        copies = {key: self.symbolic((*path, key), part) for key, part in _parts(value)}
        if isinstance(value, tuple | list):
            self.lengths.append((path, len(value)))
            return type(value)(copies.values())
        copy = object.__new__(type(value))
        copy.__dict__.update(copies)
        return copy


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


def _getter(path: Path) -> Callable[[Any], Any]:
    """What lies at a path in an argument."""
    if not path:
        return lambda value: value
    if all(isinstance(key, str) for key in path):
        return attrgetter(".".join(map(str, path)))
    return lambda value: reduce(lambda v, key: getattr(v, key) if isinstance(key, str) else v[key], path, value)


def _compare(results: Sequence[Any], traced: Sequence[Any]) -> None:
    """Raise `Untraceable` where a trace gives other results."""
    if len(results) != len(traced):
        raise Untraceable("another number of results")
    arrays = [result for result in results if isinstance(result, np.ndarray)]
    # a result that is 0 but for rounding is as inexact as the others are large
    scale = max((float(np.abs(each[np.isfinite(each)]).max(initial=0.0)) for each in arrays), default=0.0)
    for i, (result, found) in enumerate(zip(results, traced, strict=True)):
        if not isinstance(result, np.ndarray):
            if result is not found:
                raise Untraceable(f"result {i} is not the same at every call: {result}")
        elif result.shape != found.shape or not np.allclose(
            found, result, TOLERANCE, TOLERANCE * scale, equal_nan=True
        ):
            raise Untraceable(f"result {i} by symbols {found}, by numbers {result}")
