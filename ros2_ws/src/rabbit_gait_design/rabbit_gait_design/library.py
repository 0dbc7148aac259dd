"""Gait libraries by trajectory optimisation: the same specification at several step lengths and speeds."""

from collections.abc import Callable, Sequence
from math import hypot

from pydantic import ValidationError
from rabbit_description.gait import Gait, GaitLibrary

from rabbit_gait_design.design import Progress, design_gait
from rabbit_gait_design.specification import GaitSpecification

ABOVE_THE_CIRCLE = 0.03  # m, room for the swing foot above B2's circle


def library_specifications(
    base: GaitSpecification, lengths: Sequence[float], speed_slope: float = 0.0
) -> list[GaitSpecification]:
    """A specification for each of `lengths`, m, increasing; `base` is that of its own `step_length`.

    The speed changes by `speed_slope`, 1/s, with the length. The farthest stone is the gait's own, since a library
    steps at others with other gaits, and the foot may rise above the circle of B2, which is higher for a longer step.

    Raises:
        ValueError: fewer than two lengths, not increasing, or a length or speed out of its range.
    """
    if len(lengths) < 2 or sorted(set(lengths)) != list(lengths):
        raise ValueError(f"lengths = {list(lengths)}: expected two or more, increasing")
    try:
        return [_at_length(base, length, speed_slope) for length in lengths]
    except ValidationError as error:
        fault = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, fault['loc']))} = {fault['input']}: {fault['msg']}") from error


def design_library(
    base: GaitSpecification,
    lengths: Sequence[float],
    start_length: float,
    speed_slope: float = 0.0,
    progress: Callable[[str], Progress] | None = None,
) -> GaitLibrary:
    """Find the library's gaits; `progress(name)` gives the progress function of one.

    That of `start_length` is found first, then outwards, each from its neighbour's path: found each by itself, they may
    be gaits of different kinds, between which nothing walks.

    Raises:
        ValueError: see `library_specifications`; `start_length` is not among the lengths.
        GaitDesignError: IPOPT found no gait at one of the lengths.
    """
    specifications = library_specifications(base, lengths, speed_slope)
    if start_length not in lengths:
        raise ValueError(f"lengths = {list(lengths)}: expected {start_length:g}, the start's, among them")
    start, found = list(lengths).index(start_length), dict[int, Gait]()
    for at in (*range(start, len(lengths)), *range(start - 1, -1, -1)):
        each, neighbour = specifications[at], found.get(at - 1 if at > start else at + 1)
        found[at] = design_gait(each, progress and progress(each.name), neighbour)
    made_by = {"command": "rabbit gait", "specification": base.model_dump(mode="json"), "speed_slope": speed_slope}
    gaits = [found[at] for at in range(len(lengths))]
    return GaitLibrary(name=base.name, start_length=start_length, gaits=gaits, metadata=made_by)


def _at_length(base: GaitSpecification, length: float, speed_slope: float) -> GaitSpecification:
    height = hypot(length / 2, base.R2) - base.R2 + ABOVE_THE_CIRCLE
    changes = {
        "name": f"{base.name}_{round(1000 * length):04d}",
        "step_length": length,
        "speed": round(base.speed + speed_slope * (length - base.step_length), 6),
        "farthest_l_min": length,
        "max_foot_height": max(base.max_foot_height, height),
    }
    return GaitSpecification.model_validate({**base.model_dump(), **changes})
