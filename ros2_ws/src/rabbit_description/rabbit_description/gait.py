"""Gait files: periodic walks as Bézier outputs of the phase variable, with what made them.

A file holds one gait (`Gait`), or a library (`GaitLibrary`): gaits over step length and slope, between which a step of
any length and for any slope is found. `load_gaits` reads either.
"""

from functools import cached_property, lru_cache
from itertools import groupby, pairwise
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from rabbit_description import GAITS, LIBRARIES
from rabbit_description.atomic_file import replace_text
from rabbit_description.bounded_file import FileError, is_file, read_text
from rabbit_description.state import DOF, JOINTS, Array
from rabbit_description.validation import Checked, one_line, one_of
from rabbit_description.yaml_file import MOST_BYTES, dump_yaml, parse_yaml

Finite = Annotated[float, Field(allow_inf_nan=False)]
Row = Annotated[list[Finite], Field(min_length=6, max_length=6)]
State = Annotated[list[Finite], Field(min_length=DOF, max_length=DOF)]


class GaitError(ValueError):
    """A gait file that cannot be used: names the file, the field and what was expected."""


class GaitFile(Checked):
    """What a gait and a library have in common."""

    name: str

    def save(self, path: Path) -> None:
        """Write it as YAML."""
        replace_text(path, dump_yaml(self.model_dump(), default_flow_style=None, width=120))


class Gait(GaitFile):
    """A periodic gait in stance/swing coordinates `(x, z, pitch, stance hip, knee, swing hip, knee)`.

    `bezier_coeffs` (4, 6): desired stance hip, stance knee, swing hip, swing knee over the phase, rad.
    `q_start`, `dq_start` (7,): the post-impact state, stance foot at the origin. On a slope x runs along the ground
    and z at right angles to it.
    """

    step_length: float = Field(gt=0, le=1, description="nominal step length, m")
    step_time: float = Field(gt=0, le=5, description="nominal step time, s")
    slope: float = Field(0.0, gt=-45, lt=45, description="rise of the ground that it is periodic on, degrees")
    phase_angle_start: Finite = Field(description="phase angle after impact, rad")
    phase_angle_end: Finite = Field(description="phase angle at impact, rad")
    bezier_coeffs: Annotated[list[Row], Field(min_length=JOINTS, max_length=JOINTS)]
    q_start: State
    dq_start: State
    metadata: dict[str, Any] = Field(default_factory=dict, description="command, version, cost, margins, peaks")

    @model_validator(mode="after")
    def _phase_grows(self) -> Self:
        start, end = self.phase_angle_start, self.phase_angle_end
        if end <= start:
            raise ValueError(f"phase_angle_end = {end} must exceed phase_angle_start = {start}")
        return self

    def __hash__(self) -> int:
        return hash(self.name)

    @property
    def coeffs(self) -> Array:
        """Bézier coefficients, shape (4, 6), rad."""
        return np.array(self.bezier_coeffs)

    @property
    def x_start(self) -> tuple[Array, Array]:
        """Post-impact `(q, dq)`, of shape (7,), stance/swing order."""
        return np.array(self.q_start), np.array(self.dq_start)


class GaitLibrary(GaitFile):
    """Gaits over a grid of step lengths and slopes, of one degree: slope by slope, of a slope by step length.

    A library for level ground has one slope. An episode begins with the gait of `start_length`, m, for the slope
    nearest to level ground.
    """

    start_length: float = Field(gt=0, le=1, description="step length of the gait that an episode begins with, m")
    gaits: Annotated[list[Gait], Field(min_length=1, max_length=100)]
    metadata: dict[str, Any] = Field(default_factory=dict, description="what made it")

    @model_validator(mode="after")
    def _gaits_fit_together(self) -> Self:
        for one, other in pairwise(self.gaits):
            if not (one.slope, one.step_length) < (other.slope, other.step_length):
                slopes = f"slope = {one.slope:g}, {other.slope:g}"
                lengths = f"step_length = {one.step_length:g}, {other.step_length:g}"
                expected = "expected increasing slopes, in each increasing step lengths"
                raise ValueError(f"gaits {one.name} and {other.name}: {slopes}; {lengths}: {expected}")
        for slope, row in zip(self.slopes, self.rows, strict=True):
            in_row = [gait.step_length for gait in row]
            if in_row != self.lengths:
                raise ValueError(f"slope {slope:g}: step lengths {in_row}: expected {self.lengths} as in the first")
        for neighbours in (*self.rows, *zip(*self.rows, strict=True)):
            for one, other in pairwise(neighbours):
                if other.phase_angle_start > one.phase_angle_end or one.phase_angle_start > other.phase_angle_end:
                    expected = "expected ranges of the phase angle that overlap"
                    raise ValueError(f"gaits {one.name} and {other.name}: {expected}")
        if self.start_length not in self.lengths:
            raise ValueError(f"start_length = {self.start_length:g}: expected one of {self.lengths}")
        return self

    @cached_property
    def lengths(self) -> list[float]:
        """Step lengths, m, increasing; the same for each slope."""
        return [gait.step_length for gait in self.rows[0]]

    @cached_property
    def slopes(self) -> list[float]:
        """Slopes, degrees, increasing."""
        return [row[0].slope for row in self.rows]

    @cached_property
    def rows(self) -> list[list[Gait]]:
        """The gaits of each slope."""
        return [list(row) for _, row in groupby(self.gaits, lambda gait: gait.slope)]

    @cached_property
    def level(self) -> list[Gait]:
        """The gaits of the slope nearest to level ground."""
        return min(self.rows, key=lambda row: abs(row[0].slope))

    @property
    def x_start(self) -> tuple[Array, Array]:
        """Post-impact `(q, dq)` of the gait that an episode begins with, each (7,), stance/swing order."""
        return self.level[self.lengths.index(self.start_length)].x_start


Gaits = Gait | GaitLibrary


def shipped(folder: Path) -> list[str]:
    """Names of the gaits or libraries that come with the package, in `GAITS` or `LIBRARIES`."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def parse_gaits(content: Any) -> Gaits:
    """A library if there is a key `gaits`, else a gait; raises pydantic's `ValidationError`."""
    is_library = isinstance(content, dict) and "gaits" in content
    return (GaitLibrary if is_library else Gait).model_validate(content)


@lru_cache(maxsize=32)
def _gaits_of(text: str) -> Gaits:
    """A text is parsed once: a library takes a good part of a second."""
    return parse_gaits(parse_yaml(text))


def load_gaits(name_or_path: str | Path) -> Gaits:
    """Read a shipped gait or library by name, or any by path.

    Raises:
        GaitError: no such file, not YAML, a field missing, of the wrong size or not finite, or gaits that do not fit.
    """
    path = Path(name_or_path)
    if path.suffix != ".yaml":
        places = (folder / f"{name_or_path}.yaml" for folder in (GAITS, LIBRARIES))
        path = next((place for place in places if is_file(place)), path)
    if not is_file(path):
        known = [*shipped(GAITS), *shipped(LIBRARIES)]
        raise GaitError(f"gait {name_or_path}: no such file, expected {one_of(name_or_path, known)}, or a YAML file")
    try:
        return _gaits_of(read_text(path, MOST_BYTES))
    except (ValidationError, FileError) as error:
        raise GaitError(f"gait {path}: {one_line(error)}") from error


def load_gait(name_or_path: str | Path) -> Gait:
    """The same for a single gait; raises `GaitError` at a library too."""
    gait = load_gaits(name_or_path)
    if isinstance(gait, GaitLibrary):
        raise GaitError(f"gait {name_or_path}: is a library of {len(gait.gaits)} gaits; expected a single gait")
    return gait
