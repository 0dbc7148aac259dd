"""CasADi functions of named arrays, for numpy: a call takes microseconds.

    v = ca.SX.sym("v", 2)
    norm = NumpyFunction.of("norm", {"v": v}, {"size": ca.norm_2(v), "twice": 2 * v})
    norm(np.array([3.0, 4.0])).size                          # array([5.])

Every input is copied into memory that CasADi reads. All outputs lie in one row, of which each is a view.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from threading import RLock
from typing import Any, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # float64 unless said otherwise
Place = tuple[slice, tuple[int, ...]]  # where in a row an array lies, and its shape
_building = RLock()


@contextmanager
def building() -> Iterator[None]:
    """In one thread at a time expressions and functions are made: CasADi may crash with several."""
    with _building:
        yield


one_at_a_time = building()  # as a decorator


class Values:
    """The named arrays of one call, each a view of `row`: (n,) for a column, else (n, m). Of N calls a row for each."""

    __slots__ = ("row",)

    def __init__(self, row: Array) -> None:
        self.row = row

    def __getattr__(self, name: str) -> Array:
        raise AttributeError(f"no value {name}: expected one of {', '.join(vars(type(self)))}")

    def __getitem__(self, i: int) -> Self:
        """Those of call `i` of N."""
        return type(self)(self.row[i])


def view(place: slice, shape: tuple[int, ...]) -> property:
    """One of them."""
    last = ..., place
    if len(shape) == 1:
        return property(lambda values: values.row[last])
    return property(lambda values: values.row[last].reshape(values.row.shape[:-1] + shape))


def values_type(places: Mapping[str, Place]) -> type[Values]:
    """Of rows with arrays at these places."""
    return type("Values", (Values,), {name: view(*place) for name, place in places.items()})


class NumpyFunction:
    """A CasADi `function` that returns one row, with memory of its own: one object serves one thread.

    `places`: the outputs in that row. A column is an array (n,), a matrix an array (n, m), row by row.
    """

    def __init__(self, function: ca.Function, places: Mapping[str, Place]) -> None:
        self.function, self.places = function, places
        sizes = [function.numel_in(i) for i in range(function.n_in())]
        self.arguments = [(np.zeros(size), size, name) for size, name in zip(sizes, function.name_in(), strict=True)]
        self._given, self.row = 0, np.zeros(function.numel_out())  # inputs of the last call, outputs
        self._buffer, self.evaluate = function.buffer()  # `evaluate` computes with the memory as it is
        for i, (argument, *_) in enumerate(self.arguments):
            self._buffer.set_arg(i, argument.data)  # type: ignore[call-arg]  # casadi's stub is of C++
        self._buffer.set_res(0, self.row.data)  # type: ignore[call-arg]
        self.values = values_type(places)

    @property
    def fastest(self) -> ca.Function:
        """The function, compiled if it is."""
        return self.function

    @classmethod
    @one_at_a_time
    def of(
        cls, name: str, inputs: Mapping[str, ca.SX], outputs: Mapping[str, ca.SX], matrices: Collection[str] = ()
    ) -> "NumpyFunction":
        """Of expressions by name; `matrices` are outputs that stay (n, m) if they have one column."""
        arguments = [row_major(symbol) for symbol in inputs.values()]
        function = ca.Function(name, arguments, [packed(outputs)], list(inputs), ["values"], {"cse": True})
        return cls(function, places_of(outputs, matrices))

    def __call__(self, *values: Array) -> Values:
        """The outputs; inputs left out are zero. Raises ValueError where one has another size than its symbol."""
        if len(values) != self._given:
            if len(values) > len(self.arguments):
                raise ValueError(f"{len(values)} inputs; expected {', '.join(self.function.name_in())}")
            for argument, *_ in self.arguments[len(values) :]:
                argument[...] = 0
            self._given = len(values)
        for value, (argument, size, name) in zip(values, self.arguments):  # noqa: B905  those left out are zero
            if value.size != size:
                raise ValueError(f"{name} has {value.size} numbers; expected {size}")
            argument[...] = value if value.ndim == 1 else value.ravel()
        self.evaluate()
        return self.values(self.row.copy())


def row_major(value: ca.SX) -> ca.SX:
    """All elements as a column, row by row, as numpy has them."""
    return ca.vec(ca.densify(value).T)


def packed(values: Mapping[str, ca.SX]) -> ca.SX:
    """All of them as one column."""
    return ca.vertcat(ca.SX(0, 1), *(row_major(value) for value in values.values()))


def places_of(values: Mapping[str, ca.SX], matrices: Collection[str] = ()) -> dict[str, Place]:
    """Where in the column of `packed` each of these lies."""
    places, start = dict[str, Place](), 0
    for name, value in values.items():
        is_vector = value.is_column() and name not in matrices
        places[name] = slice(start, start + value.numel()), value.shape[:1] if is_vector else value.shape
        start += value.numel()
    return places


def free_symbols(expression: ca.SX, symbols: Iterable[ca.SX]) -> str:
    """Names of the symbols in an expression that are not among those given."""
    function = ca.Function("free", list(symbols), [expression], {"allow_free": True})
    return ", ".join(function.get_free()) if function.has_free() else ""
