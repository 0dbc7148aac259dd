"""CasADi functions of named arrays, for numpy: a call takes microseconds.

    v = ca.SX.sym("v", 2)
    norm = NumpyFunction.of("norm", {"v": v}, {"size": ca.norm_2(v), "twice": 2 * v})
    norm(np.array([3.0, 4.0])).size                          # array([5.])

Every input is copied into memory that CasADi reads. All outputs lie in one row, of which each is a view. A function
that is called often is compiled to C, see `compiled`, and has the same bits before and after.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from math import inf
from threading import RLock
from typing import Any, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from cbf_clf_qp.compiled import Library, c_of, is_wanted

Array = NDArray[Any]  # float64 unless said otherwise
Place = tuple[slice, tuple[int, ...]]  # where in a row an array lies, and its shape
OFTEN = 500  # calls that take as long in CasADi's virtual machine as to write the function as C
SOON = 50  # calls until the compiler is asked again
_building = RLock()


@contextmanager
def building() -> Iterator[None]:
    """Lets one thread at a time make expressions and functions: CasADi may crash with several."""
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
        """The values of call `i` of N."""
        return type(self)(self.row[i])


def view(place: slice, shape: tuple[int, ...]) -> property:
    """One of them."""
    last = ..., place
    if len(shape) == 1:
        return property(lambda values: values.row[last])
    return property(lambda values: values.row[last].reshape(values.row.shape[:-1] + shape))


def values_type(places: Mapping[str, Place]) -> type[Values]:
    """The type of rows with arrays at these places."""
    return type("Values", (Values,), {name: view(*place) for name, place in places.items()})


class NumpyFunction:
    """A CasADi `function` that returns one row, with memory of its own: one object serves one thread.

    `places`: the outputs in that row. A column is an array (n,), a matrix an array (n, m), row by row. `fastest`: the
    function, compiled once that is done; unlike `function`, it cannot be part of another one that is to be compiled.
    """

    def __init__(self, function: ca.Function, places: Mapping[str, Place]) -> None:
        self.function, self.places = function, places
        sizes = [function.numel_in(i) for i in range(function.n_in())]
        self.arguments = [(np.zeros(size), size, name) for size, name in zip(sizes, function.name_in(), strict=True)]
        self._given, self.row = 0, np.zeros(function.numel_out())  # inputs of the last call, outputs
        self._library: Library | None = None
        self._rest: float = OFTEN  # calls until it is compiled
        self._take(function)
        self.values = values_type(places)

    @classmethod
    @one_at_a_time
    def of(
        cls, name: str, inputs: Mapping[str, ca.SX], outputs: Mapping[str, ca.SX], matrices: Collection[str] = ()
    ) -> "NumpyFunction":
        """Makes one of expressions by name; `matrices` are outputs that stay (n, m) if they have one column."""
        arguments = [row_major(symbol) for symbol in inputs.values()]
        function = ca.Function(name, arguments, [packed(outputs)], list(inputs), ["values"], {"cse": True})
        return cls(function, places_of(outputs, matrices))

    def _take(self, function: ca.Function) -> None:
        self.fastest = function
        self._buffer, self.evaluate = function.buffer()  # `evaluate` computes with the memory as it is
        for i, (argument, *_) in enumerate(self.arguments):
            self._buffer.set_arg(i, argument.data)  # type: ignore[call-arg]  # casadi's stub is of C++
        self._buffer.set_res(0, self.row.data)  # type: ignore[call-arg]

    def count(self, calls: int) -> None:
        """Counts calls by others than `__call__`: after many calls it is compiled."""
        self._rest -= calls
        if self._rest <= 0:
            self.compile()

    def compile(self, wait: bool = False) -> None:
        """Have it compiled in the background, or take it from the cache; `wait` until that is done."""
        self._rest = inf
        if self.fastest is not self.function or not is_wanted():
            return
        if self._library is None:
            with building():
                text = c_of(self.function)
            if text is None:
                return
            self._library = Library(text)
        if compiled := self._library.loaded(self._external, wait):
            self._take(compiled)
        elif not self._library.failed:
            self._rest = SOON

    @one_at_a_time
    def _external(self, path: str) -> ca.Function:
        return ca.external(self.function.name(), path)

    def __call__(self, *values: Array) -> Values:
        """The outputs; inputs left out are zero. Raises ValueError where one has another size than its symbol."""
        self._rest -= 1
        if self._rest <= 0:
            self.compile()
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


class Layout:
    """A row of numbers by name: how many of each, in order."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        self.sizes = dict(sizes)
        self.places, self.size = dict[str, Place](), 0
        for name, size in sizes.items():
            self.places[name] = slice(self.size, self.size + size), (size,)
            self.size += size
        self.values = values_type(self.places)  # of a row, by name

    @classmethod
    def of(cls, function: NumpyFunction) -> "Layout":
        """The layout of the row that a function gives."""
        return cls({name: place.stop - place.start for name, (place, _) in function.places.items()})

    def parts(self, row: Any) -> dict[str, Any]:
        """The parts of a row, by name."""
        return {name: row[place] for name, (place, _) in self.places.items()}

    def joined(self, values: Mapping[str, Any]) -> Any:
        """A row of these parts."""
        return ca.vertcat(*(values[name] for name in self.sizes))


def row_major(value: ca.SX) -> ca.SX:
    """All elements as a column, row by row, as numpy has them."""
    return ca.vec(ca.densify(value).T)


def row_by_row(values: Any, columns: int) -> Any:
    """The matrix with so many columns that such a column holds."""
    return ca.reshape(values, columns, values.numel() // columns).T


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


def symmetric(matrix: ca.SX | Array) -> ca.SX:
    """The symmetric matrix with this upper triangle."""
    return ca.densify(ca.triu2symm(ca.triu(ca.SX(matrix))))


def is_finite(values: ca.SX) -> ca.SX:
    """1 where all of a few numbers are, and their sum, else 0."""
    return ca.fabs(ca.sum1(values)) < ca.inf
