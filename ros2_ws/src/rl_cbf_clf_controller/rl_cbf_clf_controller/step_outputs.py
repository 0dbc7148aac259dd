"""The outputs of one step: a gait's own, or with a library those of a step from one length into another.

A step from length A into length B begins as gait A does and ends as gait B does. Of its six control points over the
phase the first three are A's, so that it sets off from where a landing at A leaves the legs, and the last three B's, so
that it lands as B does. Its phase runs from A's start to B's end. For A = B that is the gait itself. Between the
library's lengths all of it is linear in A and in B; a length beyond an end counts as that end.

A is where the feet stand at the touchdown, B what the previewed stone asks for. The touchdown leaves the joints beside
the path, at y_0 and y_0'. So that the step begins without error, the desired outputs are

    y_d(s) = path(s) + (1 - x)^3 (a + b x)    for x = (s - s_0) / w < 1,  s_0: the phase at the touchdown,  w: width

with a = y_0 and b = w y_0' / s_0' + 3 a: then y = y' = 0 at s_0, and y_d'' is continuous where the correction ends.
"""

from dataclasses import dataclass
from typing import Protocol, TypeGuard

import numpy as np
from rabbit_description.gait import Gait, GaitLibrary, Gaits
from rabbit_description.state import Array, StonePreview

from rl_cbf_clf_controller.generated_outputs import generated_if_built
from rl_cbf_clf_controller.virtual_constraints import Outputs, Path, VirtualConstraints

FADED = 0.5  # phase at which the correction ends
LEAST_WIDTH = 0.1  # of the phase, of a correction that begins late
LEAST_RATE = 0.5  # 1/s; of a robot that hardly moves forward, y' is not made continuous


@dataclass(frozen=True)
class StepPath:
    """A path of the controlled angles: `coeffs` (m, k) over the phase, rad, and the phase angles at its ends, rad."""

    coeffs: Array
    phase_angle_start: float
    phase_angle_end: float


class StepOutputs(VirtualConstraints):
    """Outputs along `path` that are zero, with their rates, at the state that the step begins with."""

    def __init__(self, path: Path, q_s: Array, dq_s: Array) -> None:
        super().__init__(path)
        begun = super().evaluate(q_s, dq_s)
        self._begin, self._width = begun.phase, max(FADED - begun.phase, LEAST_WIDTH)
        self._a = begun.y
        self._b = self._width * begun.dy / max(begun.phase_rate, LEAST_RATE) + 3 * begun.y

    def parameters(self) -> dict[str, Array]:
        """With the correction."""
        correction = {
            "correction": np.array([self._a, self._b]),
            "correction_begin": np.array(self._begin),
            "correction_width": np.array(self._width),
        }
        return super().parameters() | correction

    def evaluate(self, q_s: Array, dq_s: Array) -> Outputs:
        """Outputs at `q_s`, `dq_s` (7,), stance/swing order."""
        path = super().evaluate(q_s, dq_s)
        value, slope, curvature = self._correction(path.phase)
        return Outputs(
            eta=path.eta - np.concatenate([value, slope * path.phase_rate]),
            jacobian=path.jacobian - np.outer(slope, self._gradient),
            bias=path.bias - curvature * path.phase_rate**2,
            phase=path.phase,
            phase_rate=path.phase_rate,
        )

    def _correction(self, phase: float) -> tuple[Array, Array, Array]:
        """Value, first and second derivative in the phase, each (4,); before the beginning, along the tangent."""
        x = (phase - self._begin) / self._width
        inside = min(max(x, 0.0), 1.0)
        left, line = 1 - inside, self._a + self._b * inside
        value = left**3 * line
        slope = (left**3 * self._b - 3 * left**2 * line) / self._width
        curvature = 6 * left * (line - left * self._b) / self._width**2
        if x < 0:
            return value + slope * (phase - self._begin), slope, np.zeros_like(slope)
        return value, slope, curvature


class OutputPath(Protocol):
    """Outputs that a trace can ask for."""

    def at(self, q_s: Array, dq_s: Array) -> Outputs: ...


class StateOutputs(Protocol):
    """Outputs at any state."""

    def evaluate(self, q_s: Array, dq_s: Array) -> Outputs: ...

    def path_at(self, q_s: Array, dq_s: Array) -> OutputPath: ...


class Steps(Protocol):
    """Where the outputs of each step come from."""

    @property
    def wanted(self) -> tuple[float, ...]:
        """The step length, m, that a policy may see; empty where there is one gait."""

    def first(self) -> StateOutputs:
        """Outputs before any step has begun."""

    def begin(self, q_s: Array, dq_s: Array, taken: float, stone: StonePreview | None) -> StateOutputs:
        """Outputs of the step that begins at this state, after one of `taken` m, towards `stone`."""


class SingleGait:
    """The same outputs in every step."""

    wanted: tuple[float, ...] = ()

    def __init__(self, gait: Gait) -> None:
        self._outputs = generated_if_built(VirtualConstraints(gait))

    def first(self) -> StateOutputs:
        """The gait's."""
        return self._outputs

    def begin(self, q_s: Array, dq_s: Array, taken: float, stone: StonePreview | None) -> StateOutputs:
        """The gait's."""
        return self._outputs


class LibrarySteps:
    """Steps through a library: from where the feet stand to `aim`, a share of the stone's width, on the stone."""

    def __init__(self, library: GaitLibrary, aim: float) -> None:
        self._library, self._aim = library, aim
        self.wanted: tuple[float, ...] = (library.start_length,)

    def first(self) -> StateOutputs:
        """Of the gait that an episode begins with."""
        self.wanted = (self._library.start_length,)
        return generated_if_built(VirtualConstraints(step_path(self._library, *self.wanted, *self.wanted)))

    def begin(self, q_s: Array, dq_s: Array, taken: float, stone: StonePreview | None) -> StateOutputs:
        """Towards the stone; where there is none, steps of the start's length."""
        if stone is not None:
            wanted = stone.l_min + self._aim * (stone.l_max - stone.l_min)
            self.wanted = (within(self._library, wanted),)
        return generated_if_built(StepOutputs(step_path(self._library, taken, *self.wanted), q_s, dq_s))


def has_lengths(gaits: Gaits) -> TypeGuard[GaitLibrary]:
    """A library in which steps have a length to choose; a library of one gait is that gait."""
    return isinstance(gaits, GaitLibrary) and len(gaits.gaits) > 1


def make_steps(gaits: Gaits, aim: float) -> Steps:
    """Of a gait, or of a library."""
    if has_lengths(gaits):
        return LibrarySteps(gaits, aim)
    return SingleGait(gaits.gaits[0] if isinstance(gaits, GaitLibrary) else gaits)


def within(library: GaitLibrary, length: float) -> float:
    """The nearest step length that the library has, m."""
    return min(max(length, library.lengths[0]), library.lengths[-1])


def interpolated(library: GaitLibrary, length: float) -> StepPath:
    """The path of the periodic step of `length`, m, linear between the library's gaits."""
    length, lengths = within(library, length), library.lengths
    at = min(int(np.searchsorted(lengths, length, side="right")), len(lengths) - 1)
    left, right = library.gaits[at - 1], library.gaits[at]
    share = (length - left.step_length) / (right.step_length - left.step_length)
    return StepPath(
        (1 - share) * left.coeffs + share * right.coeffs,
        (1 - share) * left.phase_angle_start + share * right.phase_angle_start,
        (1 - share) * left.phase_angle_end + share * right.phase_angle_end,
    )


def step_path(library: GaitLibrary, taken: float, wanted: float) -> StepPath:
    """The path from a step of `taken` into one of `wanted`, m."""
    first, last = interpolated(library, taken), interpolated(library, wanted)
    half = first.coeffs.shape[1] // 2
    coeffs = np.hstack([first.coeffs[:, :half], last.coeffs[:, half:]])
    return StepPath(coeffs, first.phase_angle_start, last.phase_angle_end)
