"""The true plant as the paper models RABBIT: stance foot pinned, inelastic impacts, its own motors, masses, bent links.

There is ground everywhere at z = 0, and no slip. Where the foot landed says whether a stone was missed. The ground can
also pull at a pinned foot, so the plant reports a negative normal force and no flight. A swing foot that has been clear
lands where its height passes zero.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from rabbit_description.planar_urdf import SLIDES
from rabbit_description.state import Array, Leg
from scipy.optimize import brentq

from rabbit_sim.actuation import Actuation
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.pinned_dynamics import PinnedDynamics
from rabbit_sim.plant import CLEAR_HEIGHT, SUBSTEP_SECONDS, Plant, PlantReading, Touch
from rabbit_sim.robot_urdf import leg_shape, perturbed_urdf

EVENT_TOLERANCE = 1e-13  # s


class RigidPlant(Plant):
    """Fixed-step RK4 at each substep of 1 ms, impacts located by bracketing."""

    def __init__(self, parameters: SimulationParameters) -> None:
        self._actuation, self._keeps_path = Actuation(parameters), parameters.needs_path
        self._tick_seconds = parameters.tick_seconds
        urdf = perturbed_urdf(parameters)
        beside = [p.joint_torque(urdf) for p in parameters.in_force() if p.has("joint_torque")]
        self._dynamics = PinnedDynamics(urdf, RabbitFeet(leg_shape(parameters)), beside, parameters.slope)

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """`q`, `dq` (7,) must have the stance foot at rest: it stays where it is. The motors are at rest."""
        self._actuation.rest()
        self._q, self._dq = q.copy(), dq.copy()
        self._impulse = np.zeros((2, 2))
        self._touches: list[Touch] = []
        self._path: list[Array] = []
        self._clear, self._pinned_for = False, 0.0
        self._pin(stance)

    def advance(self, command: Array) -> None:
        self._impulse = np.zeros((2, 2))
        self._touches = []
        self._path = []
        for torque in self._actuation.advance(command):
            self._substep(torque, SUBSTEP_SECONDS)
            if self._keeps_path:
                self._path.append(np.concatenate(self._state()))
        self._settle()

    def observe(self) -> PlantReading:
        """The truth after the last tick; an impact's impulse is part of the tick's mean force."""
        contact = np.array([self._stance is Leg.LEFT, self._stance is Leg.RIGHT])
        feet = self._dynamics.feet.positions(self._q)
        path = np.array(self._path) if self._path else None
        force = self._impulse / self._tick_seconds
        return PlantReading(self._q, self._dq, force, feet, contact, tuple(self._touches), path)

    def _substep(self, torque: Array, duration: float) -> None:
        motion = self._integrate(torque, duration)
        height = self._swing_height(motion)
        if self._clear and height < 0:
            until = brentq(lambda h: self._swing_height(self._integrate(torque, h)), 0, duration, xtol=EVENT_TOLERANCE)
            self._accept(self._integrate(torque, until), until)
            self._strike()
            self._accept(self._integrate(torque, duration - until), duration - until)
        else:
            self._accept(motion, duration)
            self._clear = self._clear or height > CLEAR_HEIGHT

    def _integrate(self, torque: Array, h: float) -> Array:
        """The motion `h` s on from the present one."""
        return runge_kutta(self._dynamics.in_chain(self._stance, torque), self._motion, h)

    def _accept(self, motion: Array, duration: float) -> None:
        self._motion = motion
        self._pinned_for += duration  # since `_settle`

    def _swing_height(self, motion: Array) -> float:
        feet = self._dynamics.feet.points([0.0, 0.0, *self._chain.out.dot(motion[0]).tolist()])
        return feet[self._stance.other][1] - feet[self._stance][1] + self._foot_height

    def _pin(self, stance: Leg) -> None:
        """Go on with this foot pinned where it is."""
        self._stance = stance
        self._chain = self._dynamics.chains[stance]
        self._foot = self._dynamics.feet.positions(self._q)[stance]
        self._foot_height = float(self._foot[1])
        self._motion = np.array([self._chain.into @ self._q[SLIDES:], self._chain.into @ self._dq[SLIDES:]])
        self._q, self._dq = self._state()

    def _state(self) -> tuple[Array, Array]:
        """`q`, `dq` (n,) of the motion."""
        q, dq = np.zeros((2, self._dynamics.coordinates))
        q[SLIDES:], dq[SLIDES:] = self._chain.out @ self._motion[0], self._chain.out @ self._motion[1]
        q[:SLIDES] = self._foot - self._dynamics.feet.positions(q)[self._stance]
        dq[:SLIDES] = -self._dynamics.feet.jacobian(q, self._stance) @ dq
        return q, dq

    def _settle(self) -> None:
        """`q`, `dq` of now; since they were of now, the ground gave what the momentum gained and the weight took."""
        before = self._dynamics.momentum(self._q, self._dq)
        self._q, self._dq = self._state()
        gained = self._dynamics.momentum(self._q, self._dq) - before
        self._impulse[self._stance] += gained + self._pinned_for * self._dynamics.weight
        self._pinned_for = 0.0

    def _strike(self) -> None:
        """The swing foot lands and is pinned; the old stance foot is free."""
        self._settle()
        landing, self._clear = self._stance.other, False
        self._dq, impulse = self._dynamics.impact(self._q, self._dq, landing)
        self._impulse[landing] += impulse
        self._pin(landing)
        x = self._dynamics.feet.positions(self._q)[:, 0].tolist()
        self._touches.append(Touch(landing, x[landing], x[landing.other], hold=True))


def runge_kutta(acceleration: Callable[[Array, Array], Array], motion: Array, h: float) -> Array:
    """One classical step of length `h`, s, of z-ddot = acceleration(z, z-dot); `motion` (2, k) has z and z-dot."""
    known = np.zeros((6, motion.shape[1]))  # z, z-dot, and the accelerations at the four stages
    known[:2] = motion
    for stage, weights in enumerate(stages(h), start=2):
        known[stage] = acceleration(motion[0], motion[1])
        motion = weights.dot(known)
    return motion


@lru_cache(maxsize=2)
def stages(h: float) -> tuple[Array, ...]:
    """What of `known` makes z and z-dot of the second to the fourth stage, and at the end; (2, 6) each."""
    return (
        np.array([[1, h / 2, 0, 0, 0, 0], [0, 1, h / 2, 0, 0, 0]]),
        np.array([[1, h / 2, h**2 / 4, 0, 0, 0], [0, 1, 0, h / 2, 0, 0]]),
        np.array([[1, h, 0, h**2 / 2, 0, 0], [0, 1, 0, 0, h, 0]]),
        np.array([[1, h, h**2 / 6, h**2 / 6, h**2 / 6, 0], [0, 1, h / 6, h / 3, h / 3, h / 6]]),
    )
