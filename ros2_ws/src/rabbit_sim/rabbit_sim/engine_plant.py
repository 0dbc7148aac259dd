"""What a plant in a physics engine does whatever the engine: a tick's substeps, each under another torque.

An engine says how it takes a substep, where the joints are, and with what force each foot stands.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from math import radians

import numpy as np
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import DOF, Array, Leg

from rabbit_sim.actuation import Actuation
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbation import Memory
from rabbit_sim.plant import CONTACT_FORCE, SUBSTEP_SECONDS, Plant, PlantReading, Span
from rabbit_sim.robot_urdf import leg_shape, perturbed_urdf, with_attached
from rabbit_sim.terrain import Ground
from rabbit_sim.touchdown_detector import Feet, TouchdownDetector

STONE_DEPTH = 1.0  # m

JointStates = tuple[list[float], list[float]]  # q, dq: seven each
Forces = list[list[float]]  # on each foot in a substep, rows left, right; columns x, z; N


class EnginePlant(Plant, ABC):
    """RABBIT on stones that are boxes; `watch` finds which feet come down.

    `feeds_back`: whether joint torques depend on the state within a tick; `keeps_path`: whether a reading has a path;
    `kinematics`: of the feet.
    """

    def __init__(self, parameters: SimulationParameters) -> None:
        self._parameters, self._perturbations = parameters, parameters.in_force()
        self._substeps = parameters.substeps
        legs = perturbed_urdf(parameters)
        self._robot_urdf = with_attached(legs, parameters)
        self._actuation = Actuation(parameters)
        self.kinematics = RabbitFeet(leg_shape(parameters))
        self._transmissions = [p for p in self._perturbations if p.has("transmitted")]
        self._joint_torques = [p.joint_torque(legs) for p in self._perturbations if p.has("joint_torque")]
        self.feeds_back = bool(self._transmissions or self._joint_torques)
        self.keeps_path = parameters.needs_path

    def close(self) -> None:
        """Break the reference cycle of plant and detector, so that the last reference frees the engine's memory."""
        vars(self).pop("watch", None)

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """A new world, so that nothing (motors, warm starts, stones) is left of the last episode."""
        self._make_world(q, dq)
        self._states: JointStates | None = None
        self._path: list[list[float]] = []
        self._actuation.rest()
        self._memories = []
        for transmission in self._transmissions:
            rng = np.random.default_rng([*q.copy().view(np.uint32), *type(transmission).__name__.encode()])
            memory = Memory(joints=q[BASE:].copy(), rates=dq[BASE:].copy(), rng=rng, parameters=self._parameters)
            transmission.begin(memory)
            self._memories.append(memory)
        self._push = np.zeros(0)  # in the next substeps, N
        self._force = np.zeros((2, 2))
        self._contact = np.array([stance is Leg.LEFT, stance is Leg.RIGHT])
        self.watch = TouchdownDetector(self._locate_feet)
        self._feet = self._locate_feet()

    def set_stones(self, spans: Sequence[Span]) -> None:
        self._place(spans)
        self.watch.ground = Ground(spans)

    def advance(self, command: Array) -> None:
        self._take_in(self._walked(self._actuation.advance(command), self.next_pushes()))

    def next_pushes(self) -> list[float]:
        """The pushes on the torso in the next tick's substeps, N."""
        pushes, self._push = self._push[: self._substeps].tolist(), self._push[self._substeps :]
        return pushes + [0.0] * (self._substeps - len(pushes))

    def follow(self, states: Array, forces: Array) -> None:
        """Take in a tick that an engine has walked elsewhere from this plant's state, as if it had been walked here.

        `states` (1 + substeps, 14): q and dq as the tick began and after each substep; `forces` (substeps, 2, 2), N.
        """
        first, *path = states.tolist()
        self._states = first[:DOF], first[DOF:]
        self._feet = self._locate_feet()
        self._take_in(self._followed(path, forces.tolist()))

    def _walked(self, torques: Array, pushes: list[float]) -> Iterator[Forces]:
        for torque, push in zip(torques if self.feeds_back else torques.tolist(), pushes, strict=True):
            self._substep(self.at_joints(torque).tolist() if self.feeds_back else torque, push)
            self._states = None
            yield self._contact_forces()

    def _followed(self, path: list[list[float]], forces: list[Forces]) -> Iterator[Forces]:
        for state, force in zip(path, forces, strict=True):
            self._states = state[:DOF], state[DOF:]
            yield force

    def _take_in(self, substeps: Iterator[Forces]) -> None:
        """What a tick's substeps leave behind."""
        self.watch.begin_tick(self._feet)
        left_x = left_z = right_x = right_z = 0.0
        self._path = []
        left, right = False, False  # in contact at any moment: a foot may bounce within the tick
        for forces in substeps:  # of so few numbers plain Python is three times as fast
            (x, z), (other_x, other_z) = forces
            left_x, left_z, right_x, right_z = left_x + x, left_z + z, right_x + other_x, right_z + other_z
            left, right = left or z > CONTACT_FORCE, right or other_z > CONTACT_FORCE
            self.watch.substep(forces)
            if self.keeps_path:
                q, dq = self._now()
                self._path.append([*q, *dq])
        self._force = np.array([[left_x, left_z], [right_x, right_z]]) / self._substeps
        self._contact = np.array([left, right])
        self._feet = self._locate_feet()

    def push(self, force: float, seconds: float) -> None:
        """See `Plant`; `seconds` are rounded to whole substeps, and a reset ends it."""
        self._push = np.full(round(seconds / SUBSTEP_SECONDS), force)

    def push_for_tick(self, forces: Array) -> None:
        self._push = np.append(self._push, np.zeros(max(self._substeps - len(self._push), 0)))
        self._push[: self._substeps] += forces

    def observe(self) -> PlantReading:
        q, dq = self._now()
        feet, touches = np.array(self._feet), tuple(self.watch.touches)
        path = np.array(self._path) if self._path else None
        return PlantReading(np.array(q), np.array(dq), self._force, feet, self._contact, touches, path)

    def at_joints(self, torque: Array) -> Array:
        """What of `torque` (4,) of the motors comes to the joints, with what acts beside them, now, N m."""
        q, dq = map(np.array, self._now())
        for transmission, memory in zip(self._transmissions, self._memories, strict=True):
            torque = transmission.transmitted(memory, torque, q[BASE:], dq[BASE:])
        return sum((beside(q, dq) for beside in self._joint_torques), torque)

    def _attached_at(self, q: Array, dq: Array) -> dict[str, tuple[float, float]]:
        """Angle and rate at a reset, by name, of the joints that perturbations have added."""
        slope = radians(self._parameters.slope)
        return {name: state for p in self._perturbations for name, state in p.attached_at(q, dq, slope).items()}

    def _locate_feet(self) -> Feet:
        return self.kinematics.points(self._now()[0])

    def _now(self) -> JointStates:
        """The joints' states, read from the engine once after each substep at most."""
        if self._states is None:
            self._states = self._joint_states()
        return self._states

    @abstractmethod
    def _place(self, spans: Sequence[Span]) -> None:
        """Have exactly these boxes. Wider by the foot's radius, so that a foot's centre on the edge still stands."""

    @abstractmethod
    def _make_world(self, q: Array, dq: Array) -> None:
        """The robot in a state, and no stone."""

    @abstractmethod
    def _substep(self, torque: list[float], push: float = 0.0) -> None:
        """Go on `SUBSTEP_SECONDS` under `torque` (4,), N m, at the joints, and `push`, N, on the torso."""

    @abstractmethod
    def _joint_states(self) -> JointStates:
        """Read from the engine."""

    @abstractmethod
    def _contact_forces(self) -> Forces:
        """The contact forces of the last substep."""
