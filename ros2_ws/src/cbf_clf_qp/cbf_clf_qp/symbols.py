"""Arrays of CasADi's symbols that numpy computes with, and what numpy cannot do with them; see `tracing.py`."""

import operator
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

ca: Any
try:
    import casadi as ca
except ImportError:  # all is computed by numpy
    ca = None

Array = NDArray[Any]


class Untraceable(ValueError):
    """What symbols cannot stand for, and why."""


class Symbol:
    """One number that is not known yet: an expression of CasADi's, `sx`, as the element of a numpy array."""

    __slots__ = ("sx",)

    def __init__(self, sx: Any) -> None:
        self.sx = sx

    def _refuse(self, *_: Any) -> Any:
        raise Untraceable("the function branches on a value, or wants it as a plain number")

    __bool__ = __float__ = __int__ = __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse
    __hash__ = object.__hash__


def _binary(function: Callable[[Any, Any], Any], is_reflected: bool = False) -> Callable[[Any, Any], Any]:
    def method(self: Symbol, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # numpy comes back with each element
        number = other.sx if isinstance(other, Symbol) else float(other)
        return Symbol(function(number, self.sx) if is_reflected else function(self.sx, number))

    return method


def _unary(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda symbol: Symbol(function(symbol.sx))


for _name in ("add", "sub", "mul", "truediv", "pow"):
    setattr(Symbol, f"__{_name}__", _binary(getattr(operator, f"__{_name}__")))
    setattr(Symbol, f"__r{_name}__", _binary(getattr(operator, f"__{_name}__"), is_reflected=True))
for _name in ("neg", "abs", "pos"):
    setattr(Symbol, f"__{_name}__", _unary(getattr(operator, f"__{_name}__")))
if ca is not None:
    for _name in ("sqrt", "exp", "log", "sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh"):
        setattr(Symbol, _name, _unary(getattr(ca, _name)))
    for _name in ("hypot", "arctan2"):
        setattr(Symbol, _name, _binary(getattr(ca, _name)))


def is_symbolic(values: Array) -> bool:
    """Whether an array has symbols in it."""
    return values.dtype == object


def at_least(values: Array, least: float) -> Array:
    """The larger of each value and `least`; NaN of NaN."""
    if is_symbolic(values):  # CasADi's fmax(NaN, least) is least
        found = to_casadi(values)
        return from_casadi(ca.if_else(found < least, least, found), values.shape)
    return np.maximum(values, least)


def smaller(first: Array, second: Array) -> Array:
    """The smaller of each two values; of a number and NaN, either."""
    if is_symbolic(first) or is_symbolic(second):
        return from_casadi(ca.fmin(to_casadi(first), to_casadi(second)), first.shape)
    return np.minimum(first, second)


def larger(first: Array, second: Array) -> Array:
    """The larger of each two values; of a number and NaN, either."""
    if is_symbolic(first) or is_symbolic(second):
        return from_casadi(ca.fmax(to_casadi(first), to_casadi(second)), first.shape)
    return np.maximum(first, second)


def all_at_most(first: Array | float, second: Array | float) -> Any:
    """1 where no value of the first is above that of the second, 0 where one is, or is NaN."""
    first, second = np.broadcast_arrays(first, second)
    if is_symbolic(first) or is_symbolic(second):
        return Symbol(ca.mmin(ca.le(to_casadi(first), to_casadi(second))))
    return float(np.all(first <= second))


def inverse(matrix: Array) -> Array:
    """`matrix`^-1 (m, m); raises numpy.linalg.LinAlgError where numbers have none."""
    if is_symbolic(matrix):
        return from_casadi(ca.inv_minor(to_casadi(matrix)), matrix.shape)
    return np.linalg.inv(matrix)


def cholesky(matrix: Array) -> Array:
    """The upper triangular R of `matrix` = R'R, positive definite (m, m)."""
    if is_symbolic(matrix):
        return from_casadi(ca.chol(to_casadi(matrix)), matrix.shape)
    return np.linalg.cholesky(matrix, upper=True)


def solve(matrix: Array, right: Array) -> Array:
    """`matrix`^-1 `right` (m, n) of a symmetric, positive definite matrix (m, m)."""
    if is_symbolic(matrix):
        D, LT, order = ca.ldl(to_casadi(matrix), False)
        return from_casadi(ca.ldl_solve(to_casadi(right), D, LT, order), right.shape)
    return np.linalg.solve(matrix, right)


def call_of_symbols(name: str, library: str, row: Array) -> Array:
    """What the compiled function of this name, which CasADi has generated, makes of a `row` of symbols."""
    results = _compiled(name, library)(to_casadi(row))
    return from_casadi(results, (results.numel(),))


@cache
def _compiled(name: str, library: str) -> Any:
    return ca.external(name, library)


def new_symbols(name: str, shape: tuple[int, ...]) -> Array:
    """An array of new symbols."""
    return from_casadi(ca.SX.sym(name, int(np.prod(shape))), shape, "C")


def to_casadi(values: Array) -> Any:
    """An array of symbols and numbers, (n, m) or (n,), as a matrix of CasADi's."""
    flat = [value.sx if isinstance(value, Symbol) else float(value) for value in values.ravel("F")]
    return ca.reshape(ca.densify(ca.vertcat(*flat)), values.shape[0], -1)


def from_casadi(matrix: Any, shape: tuple[int, ...], order: Any = "F") -> Array:
    """A matrix of CasADi's as an array of symbols."""
    values = np.empty(matrix.numel(), dtype=object)
    for i in range(values.size):
        values[i] = Symbol(ca.densify(matrix[i]))
    return values.reshape(shape, order=order)
