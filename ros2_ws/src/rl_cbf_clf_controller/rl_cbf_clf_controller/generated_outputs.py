"""The outputs of `virtual_constraints.py` and `step_outputs.py`, computed by generated C."""

import ctypes
from dataclasses import dataclass

import numpy as np
from rabbit_description.state import Array

from rl_cbf_clf_controller.generated.calls import generated
from rl_cbf_clf_controller.generated.layout import COORDINATES, OUTPUTS, POWERS
from rl_cbf_clf_controller.generated.library import GeneratedFunction, load_library
from rl_cbf_clf_controller.virtual_constraints import Outputs, VirtualConstraints

JOINTS = np.eye(COORDINATES)[3:]  # what the generated outputs control


class GeneratedOutputs:
    """The same outputs as `constraints`, but for rounding."""

    def __init__(self, library: ctypes.CDLL, constraints: VirtualConstraints) -> None:
        self._function = GeneratedFunction(library, OUTPUTS)
        self._arguments, at = self._function.arguments, self._function.argument_slices
        self._q, self._dq = at["q"], at["dq"]
        for name, values in constraints.parameters().items():
            if name == "powers":
                values = np.pad(values, ((0, 0), (0, POWERS - values.shape[1])))
            self._arguments[at[name]] = np.ravel(values)
        self._path = GeneratedPath(self._arguments[at["gradient"].start :].copy())

    def evaluate(self, q_s: Array, dq_s: Array) -> Outputs:
        """Outputs at `q_s`, `dq_s` (7,), stance/swing order."""
        self._arguments[self._q], self._arguments[self._dq] = q_s, dq_s
        found = self._function()
        return outputs_of(found)

    def path_at(self, q_s: Array, dq_s: Array) -> "GeneratedPath":
        """For a trace, which computes the outputs."""
        return self._path


@dataclass(frozen=True)
class GeneratedPath:
    """The `numbers` of a path as in `layout.PATH`, of which a trace computes the outputs."""

    numbers: Array

    def at(self, q_s: Array, dq_s: Array) -> Outputs:
        """At a state `q_s`, `dq_s` (7,), stance/swing order."""
        return outputs_of(generated(OUTPUTS, q_s, dq_s, self.numbers))


def outputs_of(found: Array) -> Outputs:
    """In the results: as in layout.FUNCTIONS[OUTPUTS]; a test compares."""
    return Outputs(
        eta=found[:8],
        jacobian=found[8:36].reshape(4, 7),
        bias=found[36:40],
        phase=found[40],
        phase_rate=found[41],
    )


def generated_if_built(constraints: VirtualConstraints) -> VirtualConstraints | GeneratedOutputs:
    """The outputs that a tick uses: generated code if it is built and fits them, else these themselves."""
    library = load_library()
    fits = np.array_equal(constraints.controlled, JOINTS) and constraints.parameters()["powers"].shape[1] <= POWERS
    if library is None or not fits:
        return constraints
    return GeneratedOutputs(library, constraints)
