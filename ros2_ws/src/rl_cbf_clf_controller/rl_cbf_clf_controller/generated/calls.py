"""The generated functions of numbers, or of symbols: so a trace calls the compiled function itself."""

import numpy as np
from cbf_clf_qp.symbols import call_of_symbols, is_symbolic
from rabbit_description.state import Array

from rl_cbf_clf_controller.generated.library import GeneratedFunction, load_library


def generated(name: str, *arguments: Array) -> Array:
    """The results (k,) of one of `layout.FUNCTIONS`; who calls it has found the library."""
    library, row = load_library(), np.concatenate(arguments)
    assert library is not None
    if is_symbolic(row):
        return call_of_symbols(name, library._name, row)
    function = GeneratedFunction(library, name)
    function.arguments[:] = row
    return function()
