"""CasADi functions of named arrays, for numpy: a call takes microseconds.

    v = ca.SX.sym("v", 2)
    norm = NumpyFunction.of("norm", {"v": v}, {"size": ca.norm_2(v), "twice": 2 * v})
    norm(np.array([3.0, 4.0])).size                          # array([5.])

Every input is copied into memory that CasADi reads. All outputs lie in one row, of which each is a view.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from functools import wraps
from threading import RLock
from typing import Any, Generic, ParamSpec, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # float64 unless said otherwise
Place = tuple[slice, tuple[int, ...]]  # where in a row an array lies, and its shape

Given = ParamSpec("Given")
Made = TypeVar("Made")
_building = RLock()


def one_at_a_time(build: Callable[Given, Made]) -> Callable[Given, Made]:
    """For what makes expressions and functions: one thread at a time, since CasADi may crash with several."""

    @wraps(build)
    def alone(*args: Given.args, **kwargs: Given.kwargs) -> Made:
        with _building:
            return build(*args, **kwargs)

    return alone


class built_once(Generic[Made]):
    """A `cached_property` that is built by `one_at_a_time`.

    Python 3.11's own holds a lock for all objects of the class, and so two threads might wait for each other.
    """

    def __init__(self, build: Callable[[Any], Made]) -> None:
        self._build, self._name, self.__doc__ = build, build.__name__, build.__doc__

    @one_at_a_time
    def __get__(self, owner: Any, kind: type) -> Made:
        if self._name not in vars(owner):
            vars(owner)[self._name] = self._build(owner)
        made: Made = vars(owner)[self._name]
        return made


class Values:
    """The named arrays of one call, each a view of `row`: (n,) for a column, else (n, m)."""

    __slots__ = ("_places", "row")

    def __init__(self, row: Array, places: Mapping[str, Place]) -> None:
        self.row, self._places = row, places

    def __getitem__(self, name: str) -> Array:
        place, shape = self._places[name]
        return self.row[place] if len(shape) == 1 else self.row[place].reshape(shape)

    def __getattr__(self, name: str) -> Array:
        if name not in self._places:
            raise AttributeError(f"no value {name}: expected one of {', '.join(self._places)}")
        return self[name]


class NumpyFunction:
    """A CasADi `function` that returns one row, with memory of its own: one object serves one thread.

    `places`: the outputs in that row. A column is an array (n,), a matrix an array (n, m), row by row. `inputs`: how
    many a call has; the others are zero.
    """

    def __init__(self, function: ca.Function, places: Mapping[str, Place], inputs: int | None = None) -> None:
        self.function, self.places = function, places
        sizes = [function.numel_in(i) for i in range(function.n_in())][:inputs]
        self._arguments = [(np.zeros(size), size) for size in sizes]
        self._row = np.zeros(function.numel_out())
        self._buffer, self.evaluate = function.buffer()  # `evaluate` computes with the memory as it is
        for i, (argument, _) in enumerate(self._arguments):
            self._buffer.set_arg(i, argument.data)  # type: ignore[call-arg]  # casadi's stub is of C++
        self._buffer.set_res(0, self._row.data)  # type: ignore[call-arg]

    @classmethod
    def of(
        cls, name: str, inputs: Mapping[str, ca.SX], outputs: Mapping[str, ca.SX], matrices: Collection[str] = ()
    ) -> "NumpyFunction":
        """Of expressions by name; `matrices` are outputs that stay (n, m) if they have one column."""
        arguments = [row_major(symbol) for symbol in inputs.values()]
        function = ca.Function(name, arguments, [packed(outputs)], list(inputs), ["values"], {"cse": True})
        return cls(function, places_of(outputs, matrices))

    def __call__(self, *values: Array) -> Values:
        """The outputs; raises ValueError where an input has another size than its symbol."""
        for (argument, size), value in zip(self._arguments, values, strict=True):
            if value.size != size:
                name = self.function.name_in(next(i for i, (each, _) in enumerate(self._arguments) if each is argument))
                raise ValueError(f"{name} has {value.size} numbers; expected {size}")
            argument[...] = value if value.ndim == 1 else value.ravel()
        self.evaluate()
        return Values(self._row.copy(), self.places)


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
        end = start + value.numel()
        is_vector = value.is_column() and name not in matrices
        places[name] = slice(start, end), value.shape[:1] if is_vector else value.shape
        start = end
    return places


def free_symbols(expression: ca.SX, symbols: Iterable[ca.SX]) -> str:
    """Names of the symbols in an expression that are not among those given."""
    function = ca.Function("free", list(symbols), [expression], {"allow_free": True})
    return ", ".join(function.get_free()) if function.has_free() else ""


def split(row: Any, places: Mapping[str, Place]) -> dict[str, Any]:
    """The expressions that were `packed` into a column."""
    parts = {}
    for name, (place, shape) in places.items():
        rows, columns = (*shape, 1)[:2]
        parts[name] = ca.reshape(row[place], columns, rows).T
    return parts
