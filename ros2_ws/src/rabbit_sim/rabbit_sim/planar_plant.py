"""The true plant of any planar robot with two point feet, from its URDF: pinned stance foot, inelastic impacts.

There is ground everywhere at z = 0 and no slip; a pinned foot can also be pulled at, so a negative normal force is
reported, not flight. A swing foot that has been clear lands where its height passes zero, if the guard allows it: the
legs of a robot without knees pass through the ground in mid-swing, and only the foot ahead of the hip may land.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array, Leg
from scipy.optimize import brentq

from rabbit_sim.parameters import SUBSTEP_SECONDS
from rabbit_sim.pinned_dynamics import PinnedDynamics
from rabbit_sim.plant import CLEAR_HEIGHT, SUBSTEPS, PlantReading, Touch

EVENT_TOLERANCE = 1e-13  # s

Motion = tuple[Array, Array, Array]  # q, dq, impulse of the ground on the stance foot
Guard = Callable[[Array, Leg], bool]  # may the swing foot land? from the feet's positions (2, 2), m, and the stance leg


def anywhere(feet: Array, stance: Leg) -> bool:
    """A swing foot may land wherever it is."""
    return True


def ahead(feet: Array, stance: Leg) -> bool:
    """A swing foot may land ahead of the stance foot."""
    return bool(feet[stance.other, 0] > feet[stance, 0])


class PlanarPlant:
    """Fixed-step RK4 at each substep of 1 ms, impacts located by bracketing; a tick lasts `TICK_SECONDS`.

    Args:
        dynamics: of the true robot, with n coordinates and n - 3 joint torques.
        may_land: the guard.
        clear_height: a foot that has been higher since its last contact, where the guard allows a landing, is clear.
        torque_limit: saturation of each joint, N m.
    """

    def __init__(
        self,
        dynamics: PinnedDynamics,
        may_land: Guard = anywhere,
        clear_height: float = CLEAR_HEIGHT,
        torque_limit: float = np.inf,
    ) -> None:
        self._dynamics, self._may_land, self._clear_height = dynamics, may_land, clear_height
        self._limit = torque_limit

    def close(self) -> None:
        """Nothing to give back."""

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """`q`, `dq` (n,) must have the stance foot at rest: it stays where it is."""
        self._q, self._dq, self._stance = q.copy(), dq.copy(), stance
        self._clear = False
        self._impulse = np.zeros((2, 2))
        self._touches: list[Touch] = []

    def advance(self, command: Array) -> None:
        """Go on one tick under joint torques (n - 3,), N m, held.

        Raises:
            ValueError: another number of torques.
        """
        if command.shape != (self._dynamics.inputs,):
            raise ValueError(f"torque of shape {command.shape}; expected ({self._dynamics.inputs},)")
        self._hold(np.broadcast_to(command.clip(-self._limit, self._limit), (SUBSTEPS, self._dynamics.inputs)))

    def push(self, force: float, seconds: float) -> None:
        """Raises: ValueError: the rigid model has no other force than the ground's."""
        raise ValueError("push: expected the plant pybullet or mujoco, the rigid one cannot be pushed")

    def observe(self) -> PlantReading:
        """The truth after the last tick; an impact's impulse is part of the tick's mean force."""
        contact = np.array([self._stance is Leg.LEFT, self._stance is Leg.RIGHT])
        feet = self._dynamics.feet.positions(self._q)
        return PlantReading(self._q, self._dq, self._impulse / TICK_SECONDS, feet, contact, tuple(self._touches))

    def _hold(self, torques: Array) -> None:
        """One tick's substeps, each under a row of `torques`."""
        self._impulse = np.zeros((2, 2))
        self._touches = []
        for torque in torques:
            self._substep(torque, SUBSTEP_SECONDS)

    def _substep(self, torque: Array, duration: float) -> None:
        motion = self._integrate(torque, duration)
        feet = self._dynamics.feet.positions(motion[0])
        height, may_land = feet[self._stance.other, 1], self._may_land(feet, self._stance)
        if self._clear and height < 0 and may_land:
            until = brentq(partial(self._swing_height, torque), 0, duration, xtol=EVENT_TOLERANCE)
            self._accept(self._integrate(torque, until))
            self._strike()
            self._accept(self._integrate(torque, duration - until))
        else:
            self._accept(motion)
            self._clear = self._clear or bool(may_land and height > self._clear_height)

    def _accept(self, motion: Motion) -> None:
        self._q, self._dq, impulse = motion
        self._impulse[self._stance] += impulse

    def _swing_height(self, torque: Array, duration: float) -> float:
        return float(self._dynamics.feet.positions(self._integrate(torque, duration)[0])[self._stance.other, 1])

    def _strike(self) -> None:
        """The swing foot lands and is pinned; the old stance foot is free."""
        self._stance, self._clear = self._stance.other, False
        self._dq, impulse = self._dynamics.impact(self._q, self._dq, self._stance)
        self._impulse[self._stance] += impulse
        x = self._dynamics.feet.positions(self._q)[:, 0].tolist()
        self._touches.append(Touch(self._stance, x[self._stance], x[self._stance.other], hold=True))

    def _integrate(self, torque: Array, h: float) -> Motion:
        """One classical Runge-Kutta step of length `h`, s, from the present state; the force is integrated with it."""
        q, v1 = self._q, self._dq
        a1, f1 = self._dynamics.accelerations(q, v1, torque, self._stance)
        v2 = v1 + h / 2 * a1
        a2, f2 = self._dynamics.accelerations(q + h / 2 * v1, v2, torque, self._stance)
        v3 = v1 + h / 2 * a2
        a3, f3 = self._dynamics.accelerations(q + h / 2 * v2, v3, torque, self._stance)
        v4 = v1 + h * a3
        a4, f4 = self._dynamics.accelerations(q + h * v3, v4, torque, self._stance)
        return (
            q + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4),
            v1 + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4),
            h / 6 * (f1 + 2 * f2 + 2 * f3 + f4),
        )
