"""Gait libraries by trajectory optimisation: one specification over step lengths, each with its speed, and slopes."""

from collections.abc import Callable, Sequence
from math import hypot
from typing import Any

from pydantic import ValidationError
from rabbit_description.gait import Gait, GaitLibrary
from rabbit_description.validation import one_line

from rabbit_gait_design.design import Progress, design_gait
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


def design_library(
    base: GaitSpecification,
    lengths: Sequence[float],
    speed_slope: float = 0.0,
    slopes: Sequence[float] = (),
    progress: Callable[[str], Progress] | None = None,
) -> GaitLibrary:
    """Find the library's gaits; `progress(name)` gives the progress function of one.

    That of `base`'s length and slope, with which a walk starts, is found first, then outwards, each from its
    neighbour's path: found each by itself, they may be gaits of different kinds, between which nothing walks.

    Raises:
        ValueError: see `library_specifications`; start's length or slope are not among those given.
        GaitDesignError: IPOPT found no gait at one of the lengths and slopes.
    """
    specifications = library_specifications(base, lengths, speed_slope, slopes)
    slopes = slopes or (base.slope,)
    for what, start, among in (("lengths", base.step_length, lengths), ("slopes", base.slope, slopes)):
        if start not in among:
            raise ValueError(f"{what} = {list(among)}: expected {start:g}, the start's, among them")
    designed = dict[Place, Gait]()
    first = (list(slopes).index(base.slope), list(lengths).index(base.step_length))
    for place, neighbour in outwards(first, (len(slopes), len(lengths))):
        spec = specifications[place[0]][place[1]]
        designed[place] = design_gait(spec, progress and progress(spec.name), neighbour and designed[neighbour])
    made_by = {"command": "rabbit gait", "specification": base.model_dump(mode="json"), "speed_slope": speed_slope}
    gaits = [designed[place] for place in sorted(designed)]
    return GaitLibrary(name=base.name, start_length=base.step_length, gaits=gaits, metadata=made_by)


def outwards(first: Place, size: Place) -> list[tuple[Place, Place | None]]:
    """All places of a grid of `size` and of each the neighbour that comes before it: along the first slope, then from
    it to the others."""
    row, column = first
    order: list[tuple[Place, Place | None]] = [(first, None)]
    order += [((row, at), (row, at - 1)) for at in range(column + 1, size[1])]
    order += [((row, at), (row, at + 1)) for at in range(column - 1, -1, -1)]
    for at in range(size[1]):
        order += [((to, at), (to - 1, at)) for to in range(row + 1, size[0])]
        order += [((to, at), (to + 1, at)) for to in range(row - 1, -1, -1)]
    return order


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
