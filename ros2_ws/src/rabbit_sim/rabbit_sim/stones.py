"""Courses of stepping stones: drawn from a distribution, or read from a file."""

import csv
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError, model_validator
from rabbit_description.bounded_file import FileError, read_text
from rabbit_description.state import Array
from rabbit_description.validation import Checked
from rabbit_description.yaml_file import MOST_BYTES, read_yaml, shortened

from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import FARTHEST_EDGE, HIGHEST_TOP

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


def read_course(path: Path, stones: int, width: float) -> list[Stone]:
    """The first `stones` stones of a file; one without `l_max` is `width` wide.

    YAML: `stones:` with a list of `{l_min: 0.35, l_max: 0.40}`. CSV: a header `l_min` or `l_min,l_max`, a row a stone.
    Either may have a `height`.

    Raises:
        CourseError: no such file, not readable as its kind, too few stones, or an edge out of bounds.
    """
    rows = _read_rows(path)
    for row in rows:
        if isinstance(row, dict) and row.get("l_max") in (None, ""):
            with suppress(KeyError, TypeError, ValueError):  # of an l_min that is refused below
                row["l_max"] = float(row["l_min"]) + width
    try:
        course = TypeAdapter(list[Stone]).validate_python(rows)
    except ValidationError as error:
        raise CourseError(f"course {path}: {_first_fault(error)}") from error
    if len(course) < stones:
        raise CourseError(f"course {path}: {len(course)} stones: expected at least {stones}")
    return course[:stones]


def _read_rows(path: Path) -> list[Any]:
    if path.suffix not in (".yaml", ".yml", ".csv"):
        raise CourseError(f"course {path}: kind {path.suffix!r}: expected .yaml or .csv")
    try:
        if path.suffix == ".csv":
            return _csv_rows(read_text(path, MOST_BYTES))
        content = read_yaml(path)
    except (FileError, csv.Error) as error:
        raise CourseError(f"course {path}: cannot be read: {error}") from error
    if not isinstance(content, dict) or set(content) != {"stones"} or not isinstance(content["stones"], list):
        raise CourseError(f"course {path}: expected a mapping with one key 'stones' and a list under it")
    return list(content["stones"])


def _csv_rows(text: str) -> list[Any]:
    rows = csv.DictReader(text.splitlines())
    names = list(rows.fieldnames or ())
    if len(set(names)) < len(names):
        raise csv.Error(f"columns {shortened(names)}: expected each once")
    return list(rows)


def _first_fault(error: ValidationError) -> str:
    fault = error.errors()[0]
    place = fault["loc"]
    stone = f"stone {int(place[0]) + 1}" if place else "stones"
    names = "".join(f" {name}" for name in place[1:])
    return f"{stone}{names} = {shortened(fault['input'])}: {fault['msg']}"
