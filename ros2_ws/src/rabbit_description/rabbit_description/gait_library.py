"""Gait libraries: gaits in the order of their step lengths, between which a step of any length is found.

A file holds one gait (`Gait`) or a library of them (`GaitLibrary`, which has `gaits`); `load_gaits` reads either.
"""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rabbit_description import GAITS, LIBRARIES
from rabbit_description.gait import Gait, GaitError, shipped_gaits
from rabbit_description.state import Array
from rabbit_description.yaml_file import YamlFileError, read_yaml


class GaitLibrary(BaseModel):
    """Gaits of increasing step length, of one degree; an episode begins with the one of `start_length`, m."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    start_length: float = Field(gt=0, le=1, description="step length of the gait that an episode begins with, m")
    gaits: Annotated[list[Gait], Field(min_length=1, max_length=100)]
    metadata: dict[str, Any] = Field(default_factory=dict, description="what made it")

    @model_validator(mode="after")
    def _gaits_fit_together(self) -> Self:
        for left, right in pairwise(self.gaits):
            here = f"gaits {left.name} and {right.name}"
            if not left.step_length < right.step_length:
                lengths = f"step_length = {left.step_length:g}, {right.step_length:g}"
                raise ValueError(f"{here}: {lengths}: expected increasing step lengths")
            if right.phase_angle_start > left.phase_angle_end or left.phase_angle_start > right.phase_angle_end:
                raise ValueError(f"{here}: expected ranges of the phase angle that overlap")
        if self.start_length not in self.lengths:
            raise ValueError(f"start_length = {self.start_length:g}: expected one of {self.lengths}")
        return self

    @property
    def lengths(self) -> list[float]:
        """Step lengths, m, increasing."""
        return [gait.step_length for gait in self.gaits]

    @property
    def x_start(self) -> tuple[Array, Array]:
        """Post-impact `(q, dq)` of the gait that an episode begins with, each (7,), stance/swing order."""
        return self.gaits[self.lengths.index(self.start_length)].x_start

    def save(self, path: Path) -> None:
        """Write the library as YAML."""
        path.write_text(yaml.safe_dump(self.model_dump(), sort_keys=False, default_flow_style=None, width=120))


Gaits = Gait | GaitLibrary


def shipped_libraries() -> list[str]:
    """Names of the libraries that come with the package."""
    return sorted(path.stem for path in LIBRARIES.glob("*.yaml"))


def parse_gaits(content: Any) -> Gaits:
    """A library if there is a key `gaits`, else a gait; raises pydantic's `ValidationError`."""
    is_library = isinstance(content, dict) and "gaits" in content
    return GaitLibrary.model_validate(content) if is_library else Gait.model_validate(content)


def load_gaits(name_or_path: str | Path) -> Gaits:
    """Read a shipped gait or library by name, or any by path.

    Raises:
        GaitError: no such file, not YAML, a field missing, of the wrong size or not finite, or gaits that do not fit.
    """
    path = Path(name_or_path)
    if path.suffix != ".yaml":
        path = next((folder / f"{name_or_path}.yaml" for folder in (GAITS, LIBRARIES) if _has(folder, path)), path)
    if not path.is_file():
        shipped = f"gaits are {', '.join(shipped_gaits())}; libraries are {', '.join(shipped_libraries())}"
        raise GaitError(f"gait: no file {path}; shipped {shipped}")
    try:
        return parse_gaits(read_yaml(path))
    except (ValidationError, YamlFileError) as error:
        raise GaitError(f"gait {path}: {error}") from error


def _has(folder: Path, name: Path) -> bool:
    return (folder / f"{name}.yaml").is_file()
