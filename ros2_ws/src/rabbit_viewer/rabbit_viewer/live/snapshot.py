"""What is shown of one tick, and what is drawn around it that the controller's parameters decide."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array, Leg


class Edges(NamedTuple):
    """A stone's near and far edge, m."""

    near: float
    far: float


class Step(NamedTuple):
    """A landing: where the foot came down and the stone it was meant for, m from the stance foot before."""

    l: float  # noqa: E741, the paper's name
    stone: Edges


@dataclass(frozen=True)
class Limits:
    """Of the controller, and the plant's `link_bend`; names, units and meaning as in their parameters."""

    R1: float
    R2: float
    stone_margin: float
    friction_coeff: float
    link_bend: float


CONTROLLERS = ("R1", "R2", "stone_margin", "friction_coeff")
SIMULATORS = ("link_bend",)


@dataclass(frozen=True)
class Snapshot:
    """One tick.

    `q` (7,) m, rad; `force` (2,): tangential, normal, on the stance foot, mean over the tick before, N; `V`; `barriers`
    (2,), m, NaN on flat ground; `torque` (4,), that acted over the tick before, N m, NaN at tick 0, in the order of the
    joints. `stone`: the one ahead, from the
    stance foot. `steps`: the last landings, the newest last; its foot is the stance foot.
    """

    episode: int
    tick: int
    nanoseconds: int  # simulated time
    q: Array
    stance: Leg
    force: Array
    touchdowns: int
    stones: int
    V: float
    barriers: Array
    clf_slack: float
    rescue_slack: float
    torque: Array
    policy: str
    stone: Edges | None
    steps: tuple[Step, ...]

    @property
    def seconds(self) -> float:
        """Since the reset."""
        return self.tick * TICK_SECONDS


def snapshot_of(state: Any, details: Any, stones: int, stone: Edges | None, steps: tuple[Step, ...]) -> Snapshot:
    """From objects with the fields of `RabbitState` and `ControllerState` of one tick."""
    stance = Leg(details.stance)
    return Snapshot(
        episode=state.episode,
        tick=state.tick,
        nanoseconds=state.stamp.sec * 1_000_000_000 + state.stamp.nanosec,
        q=np.array(state.q),
        stance=stance,
        force=np.array(state.foot_force).reshape(2, 2)[stance],
        touchdowns=state.touchdowns,
        stones=stones,
        V=details.clf,
        barriers=np.array(details.barriers),
        clf_slack=details.clf_slack,
        rescue_slack=details.rescue_slack,
        torque=np.array(state.applied),
        policy=details.policy_version,
        stone=stone,
        steps=steps,
    )
