"""Courses of stepping stones: drawn from a distribution, or read from a file."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError, ValidationInfo, model_validator
from rabbit_description.bounded_file import FileError
from rabbit_description.state import Array
from rabbit_description.validation import Checked, one_line
from rabbit_description.yaml_file import read_mapping

from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import FARTHEST_EDGE, HIGHEST_TOP

WIDTH = "width"  # of a stone, in the context of a file
Edge = Annotated[float, Field(gt=0, le=FARTHEST_EDGE, allow_inf_nan=False)]


class CourseError(ValueError):
    """A course file that cannot be used: names the file, the stone and what was expected."""


class Stone(Checked):
    """Near and far edge, m, from the stance foot (relative) or the middle of the stone before (absolute placement).

    `height`: of its top above the first platform, m.
    """

    l_min: Edge
    l_max: Edge
    height: Annotated[float, Field(ge=-HIGHEST_TOP, le=HIGHEST_TOP, allow_inf_nan=False)] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _has_usual_width(cls, row: Any, info: ValidationInfo) -> Any:
        l_min = row.get("l_min") if isinstance(row, dict) else None
        if info.context and isinstance(l_min, float) and row.get("l_max") is None:
            return {**row, "l_max": l_min + info.context[WIDTH]}
        return row

    @model_validator(mode="after")
    def _has_width(self) -> "Stone":
        if self.l_max <= self.l_min:
            raise ValueError(f"l_max = {self.l_max:g} must exceed l_min = {self.l_min:g}")
        return self


def draw_course(parameters: SimulationParameters, rng: np.random.Generator) -> list[Stone]:
    """`parameters.stones` stones, independent, from the named distribution; always the same from the same generator."""
    reach = parameters.l_min_truncation
    share = rng.uniform(size=parameters.stones)
    if parameters.l_min_distribution == "normal":
        from scipy.special import ndtr, ndtri  # slow to import

        deviation: Array = ndtri(ndtr(-reach) + share * (ndtr(reach) - ndtr(-reach))).clip(-reach, reach)
    else:
        deviation = reach * (2 * share - 1)
    near = (parameters.l_min_mean + parameters.l_min_std * deviation).tolist()
    highest = parameters.stone_height
    tops = rng.uniform(-highest, highest, parameters.stones).tolist()  # the last that is drawn: it changes no edge
    return [
        Stone(l_min=edge, l_max=min(edge + parameters.stone_width, FARTHEST_EDGE), height=top)
        for edge, top in zip(near, tops, strict=True)
    ]


class CourseFile(Checked):
    """`stones:` with a list of `{l_min: 0.35, l_max: 0.40}`, maybe with a `height`."""

    stones: list[Stone]


def read_course(path: Path, stones: int, width: float) -> list[Stone]:
    """The first `stones` stones of a YAML file; one without `l_max` is `width` wide.

    Raises:
        CourseError: no such file, not readable, too few stones, or an edge out of bounds.
    """
    try:
        course = CourseFile.model_validate(read_mapping(path), context={WIDTH: width}).stones
    except FileError as error:
        raise CourseError(f"course {path}: cannot be read: {error}") from error
    except ValidationError as error:
        raise CourseError(f"course {path}: {one_line(error)}") from error
    if len(course) < stones:
        raise CourseError(f"course {path}: {len(course)} stones: expected at least {stones}")
    return course[:stones]
