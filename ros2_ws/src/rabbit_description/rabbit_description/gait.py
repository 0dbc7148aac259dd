"""Gait files: a periodic walk as Bézier outputs of the phase variable, with what made it."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rabbit_description import GAITS
from rabbit_description.state import Array
from rabbit_description.yaml_file import YamlFileError, read_yaml

DEFAULT_GAIT = "stones_0350_080"

Finite = Annotated[float, Field(allow_inf_nan=False)]
Row = Annotated[list[Finite], Field(min_length=6, max_length=6)]
State = Annotated[list[Finite], Field(min_length=7, max_length=7)]


class GaitError(ValueError):
    """A gait file that cannot be used: names the file, the field and what was expected."""


class Gait(BaseModel):
    """A periodic gait in stance/swing coordinates `(x, z, pitch, stance hip, knee, swing hip, knee)`.

    `bezier_coeffs` (4, 6): desired stance hip, stance knee, swing hip, swing knee over the phase, rad.
    `q_start`, `dq_start` (7,): the post-impact state, stance foot at the origin.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    step_length: float = Field(gt=0, le=1, description="nominal step length, m")
    step_time: float = Field(gt=0, le=5, description="nominal step time, s")
    phase_angle_start: Finite = Field(description="phase angle after impact, rad")
    phase_angle_end: Finite = Field(description="phase angle at impact, rad")
    bezier_coeffs: Annotated[list[Row], Field(min_length=4, max_length=4)]
    q_start: State
    dq_start: State
    metadata: dict[str, Any] = Field(default_factory=dict, description="command, version, cost, margins, peaks")

    @model_validator(mode="after")
    def _phase_grows(self) -> "Gait":
        if self.phase_angle_end <= self.phase_angle_start:
            raise ValueError(
                f"phase_angle_end = {self.phase_angle_end} must exceed phase_angle_start = {self.phase_angle_start}"
            )
        return self

    @property
    def coeffs(self) -> Array:
        """Bézier coefficients, shape (4, 6), rad."""
        return np.array(self.bezier_coeffs)

    @property
    def x_start(self) -> tuple[Array, Array]:
        """Post-impact `(q, dq)`, each of shape (7,), stance/swing order."""
        return np.array(self.q_start), np.array(self.dq_start)

    def save(self, path: Path) -> None:
        """Write the gait as YAML."""
        path.write_text(yaml.safe_dump(self.model_dump(), sort_keys=False, default_flow_style=None, width=120))


def shipped_gaits() -> list[str]:
    """Names of the gaits that come with the package."""
    return sorted(path.stem for path in GAITS.glob("*.yaml"))


def load_gait(name_or_path: str | Path) -> Gait:
    """Read a shipped gait by name, or any gait by path.

    Raises:
        GaitError: no such gait, not YAML, or a field missing, of the wrong size or not finite.
    """
    path = Path(name_or_path)
    if path.suffix != ".yaml":
        path = GAITS / f"{name_or_path}.yaml"
    if not path.is_file():
        raise GaitError(f"gait: no file {path}; shipped gaits are {', '.join(shipped_gaits())}")
    try:
        return Gait.model_validate(read_yaml(path))
    except (ValidationError, YamlFileError) as error:
        raise GaitError(f"gait {path}: {error}") from error
