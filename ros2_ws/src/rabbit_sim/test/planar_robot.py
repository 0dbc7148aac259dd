"""The plant `rigid` of any planar robot with two point feet, from its URDF."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio
from rabbit_description.state import TICK_SECONDS, Array, Leg
from rabbit_sim.pinned_dynamics import PLANE, PinnedDynamics
from rabbit_sim.plant import CLEAR_HEIGHT, SUBSTEPS
from rabbit_sim.rigid_plant import RigidPlant


class UrdfFeet:
    """The origins of two links of a planar robot; see `RabbitFeet`."""

    def __init__(self, urdf: str, links: tuple[str, str] = ("left_foot", "right_foot")) -> None:
        self._model = pinocchio.buildModelFromXML(urdf)
        self._data = self._model.createData()
        self.links = links
        self._frames = [self._model.getFrameId(link) for link in links]

    def positions(self, q: Array) -> Array:
        """Of both, shape (2, 2): rows left, right."""
        pinocchio.framesForwardKinematics(self._model, self._data, q)
        return np.array([self._data.oMf[frame].translation[PLANE] for frame in self._frames])

    def points(self, q: Sequence[float]) -> Sequence[Sequence[float]]:
        """The same of plain numbers."""
        points: list[list[float]] = self.positions(np.array(q)).tolist()
        return points

    def jacobian(self, q: Array, leg: Leg) -> Array:
        """Foot velocity over `dq`, shape (2, n)."""
        world = pinocchio.LOCAL_WORLD_ALIGNED
        return pinocchio.computeFrameJacobian(self._model, self._data, q, self._frames[leg], world)[PLANE]


def dynamics_of(urdf: str, links: tuple[str, str] = ("left_foot", "right_foot")) -> PinnedDynamics:
    """Its dynamics, the feet in these links."""
    feet: Any = UrdfFeet(urdf, links)
    return PinnedDynamics(urdf, feet)


class PlanarPlant(RigidPlant):
    """It holds the commanded torques (n - 3,), N m.

    `only_ahead`: the swing foot lands only ahead of the stance foot, for legs without knees pass through the ground in
    mid-swing.
    """

    def __init__(self, dynamics: PinnedDynamics, only_ahead: bool) -> None:
        self._dynamics, self._only_ahead, self._keeps_path = dynamics, only_ahead, False
        held = lambda command: np.broadcast_to(command, (SUBSTEPS, len(command)))  # noqa: E731
        motors: Any = SimpleNamespace(rest=lambda: None, advance=held)
        self._actuation, self._tick_seconds = motors, TICK_SECONDS

    def _swing_height(self, motion: Array) -> float:
        """Neither clear nor landed where it may not land."""
        feet = self._dynamics.feet.positions(np.concatenate([np.zeros(2), self._chain.out @ motion[0]]))
        is_ahead = feet[self._stance.other, 0] > feet[self._stance, 0]
        return super()._swing_height(motion) if is_ahead or not self._only_ahead else CLEAR_HEIGHT / 2
