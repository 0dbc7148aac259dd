"""What is shown of one tick, and what is drawn around it that parameters decide."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array, Leg, StonePreview


@dataclass(frozen=True)
class Limits:
    """Of the controller, and the plant's `link_bend`; names, units and meaning as in their parameters."""

    R1: float
    R2: float
    stone_margin: float
    friction_coeff: float
    link_bend: float
    friction_margin: float
    torque_limit: float
    eps: float
    kp: float
    kd: float


@dataclass(frozen=True)
class Snapshot:
    """One tick: its `state` and `details`, objects with the fields of `RabbitState` and `ControllerState`.

    `stones`: to be walked. `stone`: the one ahead. `landings`: the last ones, the newest last; its foot is the stance
    foot; objects with the fields of `Landing`. `limits`: None until the graph has answered.
    """

    state: Any
    details: Any
    stones: int
    stone: StonePreview | None = None
    landings: tuple[Any, ...] = ()
    limits: Limits | None = None

    @property
    def q(self) -> Array:
        """Coordinates (7,), m, rad."""
        return np.array(self.state.q)

    @property
    def stance(self) -> Leg:
        """The leg that stands."""
        return Leg(self.details.stance)

    @property
    def force(self) -> Array:
        """On the stance foot, mean over the tick before: tangential, normal, N."""
        force: Array = np.array(self.state.foot_force).reshape(2, 2)[self.stance]
        return force

    @property
    def seconds(self) -> float:
        """Since the reset."""
        return float(self.state.tick * TICK_SECONDS)
