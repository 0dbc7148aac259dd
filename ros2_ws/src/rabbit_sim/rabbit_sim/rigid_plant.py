"""The true plant as the paper models it: a pinned stance foot, and an inelastic impact where the other foot lands.

There is ground everywhere at z = 0 and no slip; a pinned foot can also be pulled at, so a negative normal force is
reported, not flight. A foot that has been clear lands where its height passes zero, wherever that is.
"""

from collections.abc import Sequence

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array, Leg
from scipy.optimize import brentq

from rabbit_sim.actuation import Actuation
from rabbit_sim.kinematics import foot_positions
from rabbit_sim.parameters import SUBSTEP_SECONDS, SimulationParameters
from rabbit_sim.pinned_dynamics import PinnedDynamics
from rabbit_sim.plant import CLEAR_HEIGHT, PlantReading, Span, Touch
from rabbit_sim.robot_urdf import perturbed_urdf

EVENT_TOLERANCE = 1e-13  # s

Motion = tuple[Array, Array, Array]  # q, dq, impulse of the ground on the stance foot


class RigidPlant:
    """Fixed-step RK4 at each substep (error about 1e-10 a step), impacts located by bracketing. See `Plant`."""

    def __init__(self, parameters: SimulationParameters) -> None:
        self._bend = parameters.link_bend
        self._actuation = Actuation(parameters)
        self._dynamics = PinnedDynamics(perturbed_urdf(parameters), self._bend, parameters.joint_damping)

    def close(self) -> None:
        """Nothing to give back."""

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """`q`, `dq` must have the stance foot at rest: it stays where it is."""
        self._actuation.reset()
        self._q, self._dq, self._stance = q.copy(), dq.copy(), stance
        self._clear = False
        self._impulse = np.zeros((2, 2))
        self._touches: list[Touch] = []

    def set_stones(self, spans: Sequence[Span]) -> None:
        """Nothing to do: there is ground everywhere, and misses are told by where the foot landed."""

    def advance(self, command: Array) -> None:
        """Ten substeps, each under a constant torque."""
        self._impulse = np.zeros((2, 2))
        self._touches = []
        for torque in self._actuation.advance(command):
            self._substep(torque, SUBSTEP_SECONDS)

    def observe(self) -> PlantReading:
        """The truth after the last tick; an impact's impulse is part of the tick's mean force."""
        contact = np.array([self._stance is Leg.LEFT, self._stance is Leg.RIGHT])
        feet = foot_positions(self._q, self._bend)
        return PlantReading(self._q, self._dq, self._impulse / TICK_SECONDS, feet, contact, tuple(self._touches))

    def _substep(self, torque: Array, duration: float) -> None:
        motion = self._integrate(torque, duration)
        height = self._swing_height(motion)
        if self._clear and height < 0:
            until = brentq(lambda t: self._swing_height(self._integrate(torque, t)), 0, duration, xtol=EVENT_TOLERANCE)
            self._accept(self._integrate(torque, until))
            self._strike()
            motion = self._integrate(torque, duration - until)
        self._accept(motion)
        self._clear = self._clear or height > CLEAR_HEIGHT

    def _accept(self, motion: Motion) -> None:
        self._q, self._dq, impulse = motion
        self._impulse[self._stance] += impulse

    def _swing_height(self, motion: Motion) -> float:
        return float(foot_positions(motion[0], self._bend)[self._stance.other, 1])

    def _strike(self) -> None:
        """The swing foot lands and is pinned; the old stance foot is free."""
        self._stance, self._clear = self._stance.other, False
        self._dq, impulse = self._dynamics.impact(self._q, self._dq, self._stance)
        self._impulse[self._stance] += impulse
        x = foot_positions(self._q, self._bend)[:, 0].tolist()
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
