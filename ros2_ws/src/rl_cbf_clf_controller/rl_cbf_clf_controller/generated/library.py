"""The compiled model terms, found and called through ctypes: no CasADi at run time, 1 us a call.

`make build` puts the library under the installed package; its name has a hash of the sources that it was generated
from, so one that is out of date is not found. Without it, or with RABBIT_MODEL_TERMS=pinocchio in the environment, the
controller computes with pinocchio and numpy.
"""

import ctypes
import hashlib
import os
from functools import cache
from pathlib import Path

import numpy as np
from rabbit_description.state import Array

from rl_cbf_clf_controller.generated.layout import FUNCTIONS

PACKAGE = "rl_cbf_clf_controller"
FLAGS = ("-O2", "-shared", "-fPIC", "-ffp-contract=off")  # no fused products: the same digits on every machine
SOURCES = ("layout.py", "expressions.py", "build.py", "library.py")


def library_name() -> str:
    """Of the library that the present sources make."""
    here = Path(__file__).parent
    key = hashlib.sha256(b"\0".join((here / name).read_bytes() for name in SOURCES))
    return f"model_terms-{key.hexdigest()[:16]}.so"


@cache
def load_library() -> ctypes.CDLL | None:
    """The library of the sourced workspace, or None."""
    if os.environ.get("RABBIT_MODEL_TERMS") == "pinocchio":
        return None
    path = find_built(library_name())
    try:
        return ctypes.CDLL(str(path)) if path else None
    except OSError:  # of another machine
        return None


def find_built(name: str) -> Path | None:
    """A file that `make build` has put under the installed package."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    paths = (Path(prefix) / "lib" / PACKAGE / name for prefix in prefixes if prefix)
    return next((path for path in paths if path.is_file()), None)


class GeneratedFunction:
    """One of `layout.FUNCTIONS`: fill `arguments` (n,), call, and have the results (k,) in an array of their own."""

    def __init__(self, library: ctypes.CDLL, name: str) -> None:
        given, results = FUNCTIONS[name]
        self.argument_slices, self.result_slices = slices(given), slices(results)
        self.arguments = np.zeros(sum(int(np.prod(shape)) for shape in given.values()))
        self._results = np.zeros(sum(int(np.prod(shape)) for shape in results.values()))
        self._function = getattr(library, name)
        sizes = (ctypes.c_longlong * 4)()
        getattr(library, f"{name}_work")(*(ctypes.byref(sizes, 8 * i) for i in range(4)))
        self._kept = (
            (ctypes.c_void_p * max(sizes[0], 1))(self.arguments.ctypes.data),
            (ctypes.c_void_p * max(sizes[1], 1))(self._results.ctypes.data),
            (ctypes.c_longlong * max(sizes[2], 1))(),
            (ctypes.c_double * max(sizes[3], 1))(),
        )
        self._pointers = (*(ctypes.cast(array, ctypes.c_void_p) for array in self._kept), ctypes.c_int(0))

    def __call__(self) -> Array:
        self._function(*self._pointers)
        return self._results.copy()


def slices(layout: dict[str, tuple[int, ...]]) -> dict[str, slice]:
    """Where each array lies in its row."""
    result, start = {}, 0
    for name, shape in layout.items():
        end = start + int(np.prod(shape))
        result[name] = slice(start, end)
        start = end
    return result
