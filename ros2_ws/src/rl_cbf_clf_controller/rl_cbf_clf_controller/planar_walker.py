"""A planar walker on two point feet as a control task: its URDF, and a small file of data beside it.

    q = (foot, pitch, joints)      the stance foot's place, and the robot over it, which is pinned there
    outputs                        y = H q - path(phase), phase = (c' q - start) / (end - start): sums of coordinates
    impact                         where the swing foot comes down ahead of the stance foot it stays, and the legs swap:
                                   M (dq+ - dq-) = J' L,  J dq+ = 0, of the floating robot, inelastic, no slip

The joints are named by what their leg does: that of the stance leg is `stance_hip`, whichever leg that is. So the leg
swap is a permutation of coordinates and motors. Legs without knees pass through the ground in mid-swing: nothing lands
but ahead of the stance foot. Source: Grizzle, Abba, Plestan (2001).
"""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Self

import casadi as ca
import numpy as np
from cbf_clf_qp import Barrier, Clf, System
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import Array, NumpyFunction, packed
from cbf_clf_qp.quantity import Constrained, Rows, Terms
from cbf_clf_qp.system import solved
from pydantic import Field, field_validator, model_validator
from rabbit_description.bounded_file import FileError, read_text
from rabbit_description.planar_urdf import BASE, SLIDES, with_planar_base
from rabbit_description.task import Announced, ControlTask, Disc, Impact, Limit, Line, Shape, TaskError
from rabbit_description.validation import Checked, one_line, one_of
from rabbit_description.yaml_file import MOST_BYTES, read_mapping

from rl_cbf_clf_controller.contact_force import force_rows
from rl_cbf_clf_controller.planar_robot import PinnedRobot, rotated
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.stone_barriers import stone_barriers
from rl_cbf_clf_controller.virtual_constraints import POWERS, Angles, OutputExpressions, StepPath, path_row, path_scale

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Sum = dict[str, Finite]  # of coordinates, by name
FOOT = "foot"
MARKS = 0.5  # m, between those on the ground of a picture
FORCE_WEIGHT = 1e6  # of the slacks of the force rows
GAP_DEPTH = 0.03  # m, below which a foot beside its stone has missed it
EDGES = "l_min", "l_max"


class StonesFile(Checked):
    """Stepping stones, one a step, of which the next one is announced. Their edges, m, are from the stance foot.

    `poles`, `R1`, `R2`: of the barriers, see `stone_barriers`.
    """

    nearest: Positive = Field(description="least near edge that is drawn, m")
    farthest: Positive = Field(description="largest near edge that is drawn, m")
    width: Positive = Field(0.05, description="m")
    poles: tuple[Positive, Positive] = Field((100.0, 100.0), description="1/s")
    R1: Positive = Field(2.0, description="m")
    R2: Positive = Field(1.5, description="m")

    @model_validator(mode="after")
    def _is_range(self) -> Self:
        if self.nearest > self.farthest:
            raise ValueError(f"nearest = {self.nearest:g}, farthest = {self.farthest:g}: expected nearest <= farthest")
        return self

    def announce(self, rng: np.random.Generator, steps: int) -> Announced:
        """Edges by the number of steps."""
        near = rng.uniform(self.nearest, self.farthest, steps + 1).tolist()
        return lambda impacts: dict(zip(EDGES, (near[impacts], near[impacts] + self.width), strict=True))


class PlantFile(Checked):
    """The true robot, which the nominal model takes for one with these defaults."""

    mass: Positive = Field(1.0, description="factor of all masses and inertias")
    payload: float = Field(0.0, ge=0, allow_inf_nan=False, description="kg, on the torso")
    motors: Positive = Field(1.0, description="factor of their torques")


NOMINAL = PlantFile().model_dump()


class WalkerFile(Checked):
    """What a walker's file says beside the URDF.

    `stance`, `swing`: the URDF's joints of each leg, and its link `foot`, by one name for both legs; the stance leg is
    the one that stands first. `path`: k control points of each output over the phase, by its name, rad.
    """

    urdf: str = Field(description="the robot's file, in this folder")
    stance: dict[str, str]
    swing: dict[str, str]
    outputs: dict[str, Sum] = Field(description="what is controlled: sums of coordinates")
    phase: Sum = Field(description="the sum that grows over a step")
    path: dict[str, list[Finite]]
    phase_range: tuple[Finite, Finite] = Field(description="the sum at the begin and at the end of a step, rad")
    phase_rate: Positive = Field(description="1/s, as a step begins")
    eps: Positive = Field(0.2, le=1, description="of the CLF")
    gains: tuple[Positive, Positive] = (1.0, 1.8)
    limit: Positive = Field(description="of each motor, N m")
    fallen_pitch: Positive = Field(1.2, description="rad, either way")
    fallen_hip: Positive = Field(description="m above the stance foot")
    least_step: Positive = Field(0.05, description="m ahead of the stance foot, from which on the swing foot lands")
    stones: StonesFile | None = Field(None, description="on which it walks; without them, on flat ground")
    least_force: Positive = Field(20.0, description="N, normal to the ground, on stones")
    friction: Positive = Field(0.8, description="of the ground, on stones")
    steps: int = Field(100, ge=1, description="of an episode")
    longest_step: Positive = Field(3.0, description="s, in the mean of an episode")
    spread: tuple[Finite, Finite] = Field((0.03, 0.05), description="of the start: angles, rad; rates, a share")
    training: dict[str, Any] = Field(default_factory=dict, description="in place of the defaults of a training")
    plant: PlantFile = PlantFile()

    @model_validator(mode="before")
    @classmethod
    def _has_path(cls, said: Any) -> Any:
        if isinstance(said, dict) and "path" not in said:
            raise ValueError("path: missing; rabbit gait --task finds one")
        return said

    @field_validator("path", mode="before")
    @classmethod
    def _by_name(cls, path: Any) -> Any:
        if isinstance(path, list):
            raise ValueError("expected a row of control points by the name of each output, as in {torso: [0.3, 0.2]}")
        return path

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if set(self.stance) != set(self.swing) or FOOT not in self.stance:
            raise ValueError(
                f"stance = {self.stance}, swing = {self.swing}: expected foot and joints by the same names"
            )
        if self.phase_range[0] >= self.phase_range[1]:
            raise ValueError(f"phase_range = {self.phase_range}: expected a sum that grows")
        if self.path.keys() != self.outputs.keys():
            raise ValueError(f"path of {', '.join(self.path)}: expected that of each output, {', '.join(self.outputs)}")
        if len({len(row) for row in self.path.values()}) != 1 or min(map(len, self.path.values())) < 2:
            raise ValueError("path: expected rows of the same length, of 2 control points or more")
        return self


def read_walker(path: Path, beneath: Mapping[str, Any] = MappingProxyType({})) -> "PlanarWalker":
    """What a walker's file and its URDF say, and `beneath` what the file does not; raises `TaskError`."""
    try:
        file = WalkerFile.model_validate({**beneath, **read_mapping(path)})
        try:
            urdf = read_text(path.parent / file.urdf, MOST_BYTES)
        except FileError as error:
            raise FileError(f"urdf {file.urdf}: {error}") from error
        return PlanarWalker(path.stem, with_planar_base(urdf), file)
    except ValueError as error:  # also of what reads files, URDFs and models
        raise TaskError(f"walker {path}: {one_line(error)}") from error


def read_task(path: Path) -> ControlTask:
    """The task of a walker's file; raises `TaskError`."""
    return read_walker(path).task


class PlanarWalker:
    """Expressions of a walker: parameters `mass` (factor of all masses and inertias), `payload`, kg, and `motors`.

    Raises ValueError: a URDF that is no planar robot, or a name in the file that is not one of its joints.
    """

    def __init__(self, name: str, urdf: str, file: WalkerFile) -> None:
        self.name, self.urdf, self.file = name, urdf, file
        self.feet = file.stance[FOOT], file.swing[FOOT]
        self.numbers = read_robot(urdf, self.feet)
        legs = {"stance": file.stance, "swing": file.swing}
        named = {joint: f"{leg}_{name}" for leg, joints in legs.items() for name, joint in joints.items()}
        if missing := [joint for joint in self.numbers.names if joint not in named]:
            raise ValueError(f"stance, swing: expected also the joint {', '.join(missing)} of the URDF")
        self.motors = [named[joint] for joint in self.numbers.names]
        self.coordinates = ["pitch", *self.motors]
        self.swap = [self.motors.index(exchanged(name)) for name in self.motors]
        self.order = np.array([*range(BASE), *(BASE + place for place in self.swap)])  # the same of all coordinates
        self.parameters = {name: ca.SX.sym(name) for name in NOMINAL}
        self.robot = robot = PinnedRobot(self.numbers.structure, self._of_robot())
        foot, foot_rate = ca.SX.sym("foot"), ca.SX.sym("foot_rate")
        self.q, self.dq, self.foot = robot.q[SLIDES:], robot.dq[SLIDES:], foot
        acceleration = self._held(robot.acceleration(robot.u))[SLIDES:]
        x, x_dot = ca.vertcat(foot, self.q, foot_rate, self.dq), ca.vertcat(foot_rate, self.dq, 0, acceleration)
        self.edges = {name: ca.SX.sym(name) for name in EDGES} if file.stones else {}
        self.system = System(x, robot.u, x_dot, {**self.parameters, **self.edges})
        self.swing = self._held(robot.swing)
        rows = {name: self._row(of) for name, of in file.outputs.items()}
        self.outputs = sorted(rows, key=lambda name: (rows[name][::-1].tolist(), name))  # not as the file has them
        self.angles = Angles(np.array([rows[name] for name in self.outputs]), self._row(file.phase))
        self.path = StepPath(np.array([file.path[name] for name in self.outputs]), *file.phase_range)

    def _of_robot(self) -> dict[str, ca.SX]:
        """The parameters of `PinnedRobot`; the payload is where the torso has its centre of mass."""
        p, numbers = self.parameters, self.numbers
        links, (x, z) = p["mass"] * ca.SX(numbers.links), numbers.links[0, 1:3] / numbers.links[0, 0]
        links[0, :] += p["payload"] * ca.SX([1, x, z, x**2 + z**2]).T
        names = "joints", "feet", "joint_damping", "coulomb", "gravity"
        robot = {name: ca.SX(getattr(numbers, name)) for name in names}
        return robot | {"links": links, "motor_gain": p["motors"] * ca.SX(numbers.motor_gain)}

    def _row(self, of: Sum) -> Array:
        """A sum as factors of the robot's coordinates (n,)."""
        if strange := sorted(set(of) - set(self.coordinates)):
            raise ValueError(f"{', '.join(strange)}: expected {one_of(strange[0], self.coordinates)}")
        return np.array([0.0] * SLIDES + [of.get(name, 0.0) for name in self.coordinates])

    def _held(self, expression: ca.SX) -> ca.SX:
        """An expression of the robot's q and q', the stance foot being at rest at the origin."""
        robot, still = self.robot, ca.SX.zeros(SLIDES)
        hip, rest = ca.substitute(robot.hip, robot.q[:SLIDES], still), ca.vertcat(still, self.dq)
        rate = ca.substitute(robot.rate(robot.hip), ca.vertcat(robot.dq, robot.q[:SLIDES]), ca.vertcat(rest, still))
        slides = ca.vertcat(robot.q[:SLIDES], robot.dq[:SLIDES])
        return ca.substitute(expression, slides, ca.vertcat(hip, rate))

    @cached_property
    def impact(self) -> Impact:
        """The swing foot lands, and the legs exchange their names; the motors go on with the torques that they have."""
        robot, swing = self.robot, self.swing
        mass, jacobian = robot.mass_and_bias[0], ca.jacobian(robot.feet[1], robot.q)
        spread = solved(mass, jacobian.T)
        stopped = robot.dq - spread @ solved(jacobian @ spread, jacobian @ robot.dq)
        rates = self._held(stopped)[SLIDES:]
        order = (self.order[SLIDES:] - SLIDES).tolist()
        after = ca.vertcat(self.foot + swing[0], self.q[order], 0, rates[order])
        lands = swing[0] - self.file.least_step
        if self.edges:
            lands = ca.fmin(swing[0] - self.edges["l_min"], self.edges["l_max"] - swing[0])
        return Impact(guard=swing[1], after=after, armed=lands, held=robot.u[self.swap])

    @cached_property
    def task(self) -> ControlTask:
        """The task with the CLF of the file's outputs."""
        file, system, robot = self.file, self.system, self.robot
        outputs = OutputExpressions(robot.q, robot.dq, self.angles)
        symbols = ca.vertcat(packed(outputs.path), outputs.parameters["phase_scale"])
        numbers = ca.SX([*path_row(self.path), *path_scale(self.path)])
        along = outputs.along_path([outputs.y, outputs.phase])
        y, phase = (ca.substitute(expression, symbols, numbers) for expression in along)
        seen = ca.vertcat(y, system.derivative(y), phase, system.derivative(phase))
        names = [*self.outputs, *(f"d{name}" for name in self.outputs), "phase", "dphase"]
        hip, force = self._held(robot.hip), self._held(robot.force(robot.u))
        failed = {
            "pitch": Limit(self.q[0], -file.fallen_pitch, file.fallen_pitch, "rad"),
            "hip": Limit(hip[1], least=file.fallen_hip, unit="m"),
            "force of the ground": Limit(force[1], least=0.0, unit="N"),
        }
        quantities: list[Constrained] = [Clf(y, file.eps, gains=file.gains)]
        observation = dict(zip(names, ca.vertsplit(seen), strict=True))
        if file.stones:
            observation["l_min"], height = self.edges["l_min"], ca.fmax(-self.swing[1], 0)
            beyond = self.swing[0] > file.least_step
            failed["depth of the swing foot"] = Limit(ca.if_else(beyond, height, 0), most=GAP_DEPTH, unit="m")
            near, far = self.edges.values()
            both = stone_barriers(self.swing, near, far, 0.0, file.stones.R1, file.stones.R2)
            quantities += [Barrier(f"B{i}", B, file.stones.poles) for i, B in enumerate(both, 1)]
        return ControlTask(
            self.name,
            system,
            quantities,
            nominal=NOMINAL,
            true=file.plant.model_dump(exclude_unset=True),
            start=self.start,
            limit=file.limit,
            duration=file.steps * file.longest_step,
            observation=observation,
            constraints=[self.force_rows] if file.stones else [],
            announce=lambda rng: file.stones.announce(rng, file.steps) if file.stones else lambda _: {},
            failed=failed,
            coordinates=("foot", *self.coordinates),
            inputs=tuple(self.motors),
            draw=self.draw,
            impact=self.impact,
            impacts=file.steps,
            training=file.training,
        )

    def force_rows(self, terms: Terms) -> list[Rows]:
        """The ground pushes and does not slip, under the model."""
        force = self.robot.force
        normal_tangential = Affine(self._held(force.a[[1, 0], :]), self._held(force.b[[1, 0]])).after(terms.control)
        return force_rows(normal_tangential, ca.SX(self.file.least_force), ca.SX(self.file.friction), FORCE_WEIGHT)

    @property
    def start(self) -> tuple[list[float], list[float]]:
        """The least and the greatest first state: the path's first one, and the file's `spread` around it."""
        file, (begin, end) = self.file, self.file.phase_range
        powers = path_row(self.path)[: len(self.outputs) * POWERS].reshape(-1, POWERS)
        value, slope = powers[:, 0], powers[:, 1]  # of the polynomials of the phase, at 0
        q = self.angles.coordinates(value, begin)
        dq = file.phase_rate * self.angles.coordinates(slope, end - begin)
        room = np.concatenate([[0.0], np.full(len(q), file.spread[0]), [0.0], file.spread[1] * np.abs(dq)])
        first = np.concatenate([[0.0], q, [0.0], dq])
        return (first - room).tolist(), (first + room).tolist()

    @cached_property
    def _points(self) -> NumpyFunction:
        """A picture's points from the stance foot, m: `hip`, `top` of the torso; each leg from foot to hip, columns."""
        robot, (x, z) = self.robot, 2 * self.numbers.links[0, 1:3] / self.numbers.links[0, 0]
        points = {"hip": robot.hip, "top": robot.hip + rotated(ca.SX([x, z]), robot.q[SLIDES])}
        for name, foot, link in zip(("stance", "swing"), robot.feet, robot.structure.feet, strict=True):
            chain = [foot]
            while link:
                chain.append(robot.links[link].origin)
                link = robot.structure.parents[link - 1]
            points[name] = ca.horzcat(*chain, robot.q[:SLIDES]) - robot.feet[0]
        held = {name: self._held(point) for name, point in points.items()}
        return NumpyFunction.of("points", {"q": self.q}, held, ("stance", "swing"))

    def draw(self, x: Array, p: Mapping[str, float]) -> list[Shape]:
        """The robot where its hip stands still, and the ground with its marks, which pass."""
        at = self._points(x[1 : 1 + self.q.numel()])
        place, over = x[0] + at.hip[0], np.array([at.hip[0], 0.0])
        legs = [Line(at.swing.T - over, "tab:gray", 5), Line(at.stance.T - over, "tab:blue", 5)]
        torso = Line(np.array([at.hip, at.top]) - over, "black", 6)
        ground = Line(np.array([[-1.0, 0.0], [1.0, 0.0]]), width=1)
        if self.edges:
            foot, half = -at.hip[0], (p["l_max"] - p["l_min"]) / 2
            edges = (foot - half, foot + half), (foot + p["l_min"], foot + p["l_max"])
            stones = [Line(np.array([[near, 0.0], [far, 0.0]]), width=3) for near, far in edges]
            return [*stones, *legs, torso]
        first = np.ceil((place - 1) / MARKS) * MARKS
        marks = [Disc(np.array([mark - place, 0.0]), 0.012, "black") for mark in np.arange(first, place + 1, MARKS)]
        return [ground, *marks, *legs, torso]


def exchanged(name: str) -> str:
    """The same joint of the other leg."""
    leg, _, rest = name.partition("_")
    return f"{'swing' if leg == 'stance' else 'stance'}_{rest}"
