"""The actor's network, with ReLU and tanh: `network.c`, once many rows were asked for, or numpy with the same bits.

In double precision, with libm's tanh. Each unit adds to its bias its inputs times their weights, in order, and leaves
out inputs that are zero, as half of them are behind a ReLU. BLAS adds in another order, and numpy has another tanh:
outputs would differ in the last bits.
"""

import ctypes
from math import inf, tanh
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.compiled import Library
from cbf_clf_qp.functions import OFTEN, SOON
from numpy.typing import NDArray

SOURCE = Path(__file__).with_name("network.c")
LAYERS = 3


class CompiledNetwork:
    """`forward` of `network.c`, for all networks of the process; None as long as it is not compiled."""

    def __init__(self) -> None:
        self.forward: Any = None
        self._library: Library | None = None
        self._rest: float = OFTEN  # rows until it is compiled

    def count(self, rows: int) -> None:
        """So many rows are asked for: after many it is compiled in the background."""
        self._rest -= rows
        if self._rest <= 0:
            self.compile()

    def compile(self, wait: bool = False) -> None:
        """Have it compiled, or take it from the cache; `wait` until that is done."""
        self._library = self._library or Library(SOURCE.read_text(), "-O3")
        self.forward = self.forward or self._library.loaded(forward_of, wait)
        self._rest = inf if self.forward or self._library.failed else SOON


NETWORK = CompiledNetwork()


def forward_of(path: str) -> Any:
    """That of the library there."""
    function = ctypes.CDLL(path).forward
    pointer, integer = ctypes.c_void_p, ctypes.c_longlong
    function.argtypes, function.restype = (integer, pointer, integer, pointer, pointer, pointer, pointer), None
    return function


class Actor:
    """The network of these arrays: from a scaled observation (m,), or N of them (N, m), to outputs in [-1, 1].

    What `forward` of `network.c` needs: `weights`, float32, `biases`, `sizes` of the layers, the `widest` that is read,
    how many `units` there are, of which the last are the `outputs`.
    A row of N has the bits that it has alone. One object serves one thread. Raises ValueError for observations of
    another size.
    """

    def __init__(self, arrays: dict[str, NDArray[np.float32]]) -> None:
        self._arrays = arrays
        weights = [arrays[f"{i}.weight"].T for i in range(LAYERS)]
        biases = [arrays[f"{i}.bias"] + 0.0 for i in range(LAYERS)]  # no -0.0, which a term of zero would make 0.0
        self.weights = np.concatenate([layer.ravel() for layer in weights], dtype=np.float32)
        self.biases = np.concatenate(biases, dtype=float)
        self.sizes = np.array([len(weights[0]), *map(len, biases)])
        self.inputs, self.outputs = len(weights[0]), len(biases[-1])
        self.widest, self.units = int(self.sizes[:-1].max()), int(self.sizes[1:].sum())
        self._rows = ActorRows(self, 1)

    def __reduce__(self) -> tuple[Any, ...]:  # a copy has its own addresses
        return Actor, (self._arrays,)

    def __call__(self, scaled: NDArray[Any]) -> NDArray[np.float64]:
        *many, inputs = scaled.shape
        if inputs != self.inputs:
            raise ValueError(f"observations have {inputs} numbers; expected {self.inputs}")
        n = scaled.size // inputs
        if n != len(self._rows.x):
            self._rows = ActorRows(self, n)
        self._rows.x[...] = scaled.reshape(n, inputs)
        return self._rows().reshape(*many, self.outputs).copy()

    def in_numpy(self, y: NDArray[Any]) -> NDArray[Any]:
        """The outputs for one observation, before tanh."""
        at = bias_at = 0
        for layer, (inputs, outputs) in enumerate(zip(self.sizes[:-1], self.sizes[1:], strict=True)):
            if layer:
                y = np.maximum(y, 0.0)
            used = y.nonzero()[0]
            weights, bias = self.weights[at : at + inputs * outputs], self.biases[bias_at : bias_at + outputs]
            terms = np.zeros((len(used) + 1, outputs + 1))  # numpy would add up a single column in another order
            terms[0, :-1] = bias
            np.multiply(weights.reshape(inputs, outputs)[used], y[used, None], out=terms[1:, :-1])
            y = np.add.reduce(terms, axis=0)[:-1]
            at, bias_at = at + inputs * outputs, bias_at + outputs
        return y


class ActorRows:
    """An actor bound to `n` observations `x` (n, m): each call computes their outputs (n, outputs)."""

    def __init__(self, actor: Actor, n: int) -> None:
        self._actor, self.x, memory = actor, np.empty((n, actor.inputs)), np.empty(actor.widest + n * actor.units)
        self.y = memory[memory.size - n * actor.outputs :].reshape(n, actor.outputs)
        layers = actor.sizes.ctypes.data, actor.widest, actor.weights.ctypes.data, actor.biases.ctypes.data
        self._given = n, *layers, self.x.ctypes.data, memory.ctypes.data

    def __call__(self) -> NDArray[np.float64]:
        NETWORK.count(len(self.x))
        if NETWORK.forward:
            NETWORK.forward(*self._given)
        else:
            with np.errstate(all="ignore"):  # as in C
                for x, y in zip(self.x, self.y, strict=True):
                    y[:] = [*map(tanh, self._actor.in_numpy(x).tolist())]
        return self.y
