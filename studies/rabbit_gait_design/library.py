"""Gait libraries by trajectory optimisation: one specification over step lengths, each with its speed, and slopes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from math import hypot
from typing import Any

from pydantic import ValidationError
from rabbit_description.gait import Gait, GaitLibrary
from rabbit_description.validation import one_line
from rabbit_experiments.cache import Cache, Job, JobError
from rabbit_experiments.engine import run

from rabbit_gait_design.design import GaitDesignError, design_gait
from rabbit_gait_design.specification import GaitSpecification

ABOVE_THE_CIRCLE = 0.03  # m, room for the swing foot above B2's circle

Place = tuple[int, int]  # of a gait in the library: which slope, which length


def library_specifications(
    base: GaitSpecification, lengths: Sequence[float], speed_slope: float = 0.0, slopes: Sequence[float] = ()
) -> list[list[GaitSpecification]]:
    """The specifications for each of `slopes`, degrees, and `lengths`, m; `base` is that of its own.

    Both increase; without `slopes` there is that of `base` alone. The speed changes by `speed_slope`, 1/s, with the
    length. The farthest stone is the gait's own, since a library steps at others with other gaits, and the foot may
    rise above the circle of B2, which is higher for a longer step.

    Raises:
        ValueError: fewer than two lengths, not increasing, or a length, speed or slope out of its range.
    """
    slopes = slopes or (base.slope,)
    if len(lengths) < 2 or sorted(set(lengths)) != list(lengths):
        raise ValueError(f"lengths = {list(lengths)}: expected two or more, increasing")
    if sorted(set(slopes)) != list(slopes):
        raise ValueError(f"slopes = {list(slopes)}: expected increasing ones")
    try:
        return [[_one(base, length, speed_slope, slope, len(slopes) > 1) for length in lengths] for slope in slopes]
    except ValidationError as error:
        raise ValueError(one_line(error)) from error


@dataclass(frozen=True)
class GaitSearch(Job):
    """The search for a gait, which begins with the path of a neighbour."""

    specification: GaitSpecification
    neighbour: Gait | None
    model = Gait

    def do(self) -> Gait:
        try:
            return design_gait(self.specification, guess=self.neighbour)
        except GaitDesignError as error:
            raise JobError(str(error)) from error


def design_library(
    base: GaitSpecification,
    lengths: Sequence[float],
    speed_slope: float,
    slopes: Sequence[float],
    cache: Cache,
    processes: int | str = 1,
) -> GaitLibrary:
    """Find the library's gaits that the cache lacks; see `engine.run` for `processes`.

    That of `base`'s length and slope, with which a walk starts, is found first, then outwards, each from its
    neighbour's path: found each by itself, they may be gaits of different kinds, between which nothing walks.

    Raises:
        ValueError: see `library_specifications`; start's length or slope are not among those given.
        JobError: IPOPT found no gait at one of the lengths and slopes.
    """
    specifications = library_specifications(base, lengths, speed_slope, slopes)
    slopes = slopes or (base.slope,)
    for what, start, among in (("lengths", base.step_length, lengths), ("slopes", base.slope, slopes)):
        if start not in among:
            raise ValueError(f"{what} = {list(among)}: expected {start:g}, the start's, among them")
    designed = dict[Place, Gait]()
    first = (list(slopes).index(base.slope), list(lengths).index(base.step_length))
    for places in outwards(first, (len(slopes), len(lengths))):
        searches = {}
        for (i, j), neighbour in places:
            specified = specifications[i][j]
            searches[i, j] = GaitSearch(specified, designed.get(neighbour), title=f"gait {specified.name}")
        run([*searches.values()], cache, processes)
        designed |= {place: cache.get(search) for place, search in searches.items()}
    made_by = {"command": "rabbit gait", "specification": base.model_dump(mode="json"), "speed_slope": speed_slope}
    gaits = [designed[place] for place in sorted(designed)]
    return GaitLibrary(name=base.name, start_length=base.step_length, gaits=gaits, metadata=made_by)


def outwards(first: Place, size: Place) -> Iterable[list[tuple[Place, Place]]]:
    """All places of a grid of `size`, those together that are equally far from the first, in steps along the rows and
    columns; and of each the neighbour from which a search begins: along the first row, then from it to the others."""

    def far(place: Place) -> int:
        return abs(place[0] - first[0]) + abs(place[1] - first[1])

    for _, places in groupby(sorted(product(range(size[0]), range(size[1])), key=far), far):
        yield [(place, towards(first, place)) for place in places]


def towards(first: Place, place: Place) -> Place:
    """The next row towards the first place; in its row the next column."""
    (row, column), (to_row, to_column) = place, first
    if row != to_row:
        return row + (1 if row < to_row else -1), column
    return row, column + (column < to_column) - (column > to_column)


def _one(
    base: GaitSpecification, length: float, speed_slope: float, slope: float, names_slope: bool
) -> GaitSpecification:
    height = hypot(length / 2, base.R2) - base.R2 + ABOVE_THE_CIRCLE
    changes: dict[str, Any] = {
        "name": f"{base.name}_{round(1000 * length):04d}" + (f"_slope{slope:+g}" if names_slope else ""),
        "step_length": length,
        "slope": slope,
        "speed": round(base.speed + speed_slope * (length - base.step_length), 6),
        "farthest_l_min": length,
        "max_foot_height": max(base.max_foot_height, height),
    }
    return GaitSpecification.model_validate({**base.model_dump(), **changes})
