"""What a perturbation of the true plant is: fields that users set, and hooks that the plant calls.

A class in a file of `perturbations/` that derives from `Perturbation` is one. The fields are flat among those of
`SimulationParameters`; options, ROS parameters and the page's controls follow from them. A hook that the class does not
override changes nothing, and a perturbation whose fields are at their defaults is not asked at all.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar, Self
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import AfterValidator, Field
from rabbit_description.state import Array, RobotState
from rabbit_description.validation import Checked

from rabbit_sim.plant import PlantReading

Parameters = Any  # `SimulationParameters`, which is made of the perturbations
NEARLY_ZERO = 1e-300  # smaller numbers are zero: a product with one leaves the range in which MuJoCo reads
Number = Annotated[
    float, Field(allow_inf_nan=False), AfterValidator(lambda value: value if abs(value) >= NEARLY_ZERO else 0.0)
]
ENGINES_ALONE = "engines alone"  # marks a field that the plant `rigid` cannot have
WHOLE_SUBSTEPS = "whole substeps"  # marks a time that is a number of them
EngineNumber = Annotated[Number, ENGINES_ALONE]
WholeSubsteps = Annotated[Number, WHOLE_SUBSTEPS]


@dataclass(frozen=True)
class Control:
    """How the page of `rabbit play` shows a field: title, step and unit; narrower bounds if they are given.

    `at_reset`: a change waits for the next reset. `first`: above the group "laboratory".
    """

    title: str
    step: float = 1
    unit: str = ""
    low: float | None = None
    high: float | None = None
    at_reset: bool = False
    first: bool = False


def setting(default: Any, low: Any, high: Any, description: str, control: Control | None = None) -> Any:
    """A field from `low` to `high`; None: no bound. Without a `control` the page does not show it."""
    extra: Any = {"control": control and asdict(control)}
    return Field(default, ge=low, le=high, description=description, json_schema_extra=extra)


Memory = SimpleNamespace  # what a perturbation remembers of an episode, under any names
JointTorque = Callable[[Array, Array], Array]  # on the joints (4,), N m, of q and dq (7,)


class Perturbation(Checked):
    """See above. Of those that have the same hook, the one of the lower `order` acts first."""

    order: ClassVar[int] = 500
    acts_always: ClassVar[bool] = False  # also with its fields at their defaults
    switches: ClassVar[tuple[str, ...]] = ()  # fields that put it in force; empty: any of them
    needs_path: ClassVar[bool] = False  # `measure` needs the states within a tick

    @classmethod
    def of(cls, parameters: Parameters) -> Self:
        """The one that these parameters have."""
        values = {name: getattr(parameters, name) for name in cls.model_fields}
        return cls.model_construct(**values)  # type: ignore[return-value]  # pydantic's plug-in forgets Self

    @classmethod
    def of_all(cls, robots: Sequence[Parameters]) -> Self:
        """The perturbations of N robots in one, whose fields are arrays (N, 1, 1)."""
        values: dict[str, Any] = {name: np.array([[[getattr(p, name)]] for p in robots]) for name in cls.model_fields}
        return cls.model_construct(**values)  # type: ignore[return-value]

    @classmethod
    def is_in_force(cls, parameters: Parameters) -> bool:
        """Whether they have one that is not at its defaults."""
        fields, names = cls.model_fields, cls.switches or cls.model_fields
        return cls.acts_always or any(getattr(parameters, name) != fields[name].default for name in names)

    @classmethod
    def has(cls, hook: str) -> bool:
        """Whether it overrides a hook."""
        return getattr(cls, hook) is not getattr(Perturbation, hook)

    def begin(self, memory: Memory) -> None:
        """An episode begins; what is in the `memory` by then, the hooks say that get it."""

    def change_robot(self, robot: Element) -> None:
        """Change masses, inertias and lengths of the URDF in place. The oracle knows it."""

    def attach(self, robot: Element) -> None:
        """Add links that move in further joints to the URDF, for an engine."""

    def attached_at(self, q: Array, dq: Array, slope: float) -> dict[str, tuple[float, float]]:
        """Where these joints are at a reset to q, dq (7,): angle and rate by name; the ground rises by `slope` rad."""
        return {}

    def remembered(self) -> int:
        """How many rows (4,) its motors remember, at most; zeros are rest."""
        return 0

    def drive(self, torques: Array, state: Array) -> Array:
        """What the motors of N robots (`of_all`) make of the torques over one tick's substeps, both (N, substeps, 4).

        N m. It may change its arguments: `state` (N, remembered, 4) goes on to the next tick.
        """
        return torques

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        """What comes to the joints (4,), N m, over the next substep, in which the motors' side gives `torque` (4,).

        `joints`, `rates` (4,): rad, rad/s; those of the reset are in the memory.
        """
        return torque

    def joint_torque(self, urdf: str) -> JointTorque:
        """Beside the motors, of the robot in `urdf` with nothing attached. It remembers nothing, so `rigid` has it."""
        raise NotImplementedError

    def force(self, memory: Memory, tick: int) -> Array:
        """The force in the substeps of a tick, counted from the reset, along the ground on the torso's centre of mass.

        (substeps,), N; asked for once a tick. The memory has an `rng` of this perturbation and episode, and all
        `parameters`.
        """
        raise NotImplementedError

    def drop(self, stone: int, offset: float) -> float:
        """By how much the top of stone `stone`, from 1, gives way under the first foot on it, m.

        The foot stands `offset` m ahead of its middle.
        """
        return 0.0

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        """Change what a tick's `state` says, in place; called once for each tick, the first time right after a reset.

        The memory has the episode's `rng`, which all share that measure, and all `parameters`. It goes on where
        parameters change between two ticks.
        """
