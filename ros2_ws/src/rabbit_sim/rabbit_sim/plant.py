"""What the simulation asks of a plant, whatever its physics."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, radians, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rabbit_description.state import TICK_SECONDS, Array, Leg
from rabbit_description.tick import SUBSTEP_SECONDS as SUBSTEP_SECONDS

SUBSTEPS = round(TICK_SECONDS / SUBSTEP_SECONDS)  # of the usual tick
CONTACT_FORCE = 1.0  # N, a foot that carries more is in contact
CLEAR_HEIGHT = 0.005  # m, a foot that has been higher since its last contact is clear, and can come down

FOOT_RADIUS = 0.002  # m, of the URDF's foot sphere: a foot's centre at z = 0 stands on a top at -FOOT_RADIUS
GRAVITY = 9.81  # m/s^2
FARTHEST_EDGE = 0.9  # m from the stance foot, of any stone
HIGHEST_TOP = 0.2  # m above or below the first platform, of any stone
NOT_PUSHED = "push: expected the plant pybullet or mujoco, this one cannot be pushed"


def gravity(slope: float) -> tuple[float, float]:
    """Along and normal to ground that rises by `slope` degrees, in whose frame the plant is; m/s^2."""
    return -GRAVITY * sin(radians(slope)) + 0.0, -GRAVITY * cos(radians(slope))  # no negative zero


class Span(NamedTuple):
    """Near and far edge of a stone's top, world x, m; `top`: height of a foot's centre that touches it, world z, m."""

    near: float
    far: float
    top: float = 0.0


@dataclass(frozen=True)
class Touch:
    """A foot that had been clear came down, its centre at world `x`, the other's at `other_x`, m.

    `hold` is False where it fell into a gap or against a stone's side.
    """

    leg: Leg
    x: float
    other_x: float
    hold: bool


@dataclass  # not frozen: that would take a tick 2 us
class PlantReading:
    """The truth after a tick, world frame.

    `q`, `dq` (7,): m, rad and their rates. `foot_force` (2, 2): rows left, right; columns tangential, normal; N,
    averaged over the tick. `foot_position` (2, 2): columns x, z; m. `contact` (2,): at some moment of the tick, on
    `rigid` at its end. `touches`: the feet that came down during the tick, in order. `path` (substeps, 14): q and dq at
    each substep's end, for sensors that are faster than a tick; None if nobody asked for it or no tick was walked.
    """

    q: Array
    dq: Array
    foot_force: Array
    foot_position: Array
    contact: NDArray[np.bool_]
    touches: tuple[Touch, ...]
    path: Array | None = None


class Plant:
    """The true robot and its ground; one tick lasts `tick_seconds` of its parameters."""

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """Put the robot into a state, its motors at rest, and take away every stone."""
        raise NotImplementedError

    def set_stones(self, spans: Sequence[Span]) -> None:
        """Have exactly these stones; nothing to do where there is ground everywhere."""

    def set_friction(self, leg: Leg, coefficient: float) -> None:
        """Coulomb's coefficient of what a foot stands on from now on, until the reset."""
        raise NotImplementedError

    def advance(self, command: Array) -> None:
        """Go on one tick under the commanded joint torques, shape (4,), N m."""
        raise NotImplementedError

    def push(self, force: float, seconds: float) -> None:
        """Push the torso's centre of mass forward with `force`, N, from now on; a push under way ends.

        Raises:
            ValueError: this plant cannot be pushed.
        """
        raise ValueError(NOT_PUSHED)

    def push_for_tick(self, forces: Array) -> None:
        """Likewise in each substep of the next tick, (substeps,) N, beside a push under way; raises as `push`."""
        raise ValueError(NOT_PUSHED)

    def observe(self) -> PlantReading:
        """The truth after the last tick."""
        raise NotImplementedError

    def close(self) -> None:
        """Give back what the plant holds; it cannot be used afterwards."""
