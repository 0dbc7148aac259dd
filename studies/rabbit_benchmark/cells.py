"""The cells of the benchmark: what the true plant is, by name, and the plants of the storm.

A name is TERRAIN/PLANT: `stones/scale-2`, `flat/40kg-ground-5e4`, `stones/storm`, `flat/gusts` (a family's).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import BeforeValidator, Field
from rabbit_description.validation import Checked, one_of
from rabbit_description.yaml_file import parse_yaml

from rabbit_benchmark.families import Split, families, family_plant, further_changes, in_order, settable

Terrain = Literal["stones", "flat"]
Map = Literal["inside", "outside", "storm", "development", "reported", "unseen", "unseen-2", "contact", "storm-2"]
TERRAINS: tuple[Terrain, ...] = ("stones", "flat")
PLANTS: dict[Map, int] = {"storm": 10, "storm-2": 10, **dict.fromkeys(get_args(Split), 2)}  # for a cell's course


@dataclass(frozen=True)
class Cell:
    """A terrain and changes of `SimulationParameters`; those of storms and families are drawn for each course."""

    name: str
    map: Map
    terrain: Terrain
    values: dict[str, Any] = field(default_factory=dict, hash=False)

    def courses(self, courses: int) -> int:
        """How many there are where another cell has `courses`."""
        return courses * PLANTS.get(self.map, 1)

    def plant(self, run: int, seed: int) -> dict[str, Any]:
        """The changes for course `run`; `seed` is the protocol's."""
        changes = self.values
        if self.map in get_args(Split):
            changes = family_plant(self.name.split("/")[1], run, seed, self.terrain)
        elif self.map == "storm-2":
            changes = second_storm_plant(run, seed, self.terrain)
        elif self.map == "storm":
            changes = storm_plant(run, seed, self.terrain)
        return {**changes, "terrain": self.terrain}


class CellError(ValueError):
    """No such cell."""


class Storm(Checked):
    """What storm.yaml says."""

    share: Annotated[float, Field(gt=0, le=1)]
    ranges: Annotated[dict[str, tuple[float, float]], BeforeValidator(in_order)]
    choices: Annotated[dict[str, str], BeforeValidator(in_order)]
    on_stones: Annotated[dict[str, tuple[float, float]], BeforeValidator(in_order)]

    def on(self, terrain: Terrain) -> dict[str, tuple[float, float]]:
        """Ranges by parameter."""
        return self.ranges | (self.on_stones if terrain == "stones" else {})


@cache
def storm() -> Storm:
    """The committed ranges."""
    return Storm.model_validate(parse_yaml((files(__package__) / "storm.yaml").read_text(encoding="utf-8")))


def storm_plant(number: int, seed: int, terrain: Terrain) -> dict[str, Any]:
    """Plant `number` of the storm, the same for the same arguments on every machine."""
    rng = np.random.default_rng([seed, number, TERRAINS.index(terrain)])
    changes: dict[str, Any] = {}
    for name, (low, high) in storm().on(terrain).items():
        changed, value = rng.random() < storm().share, float(rng.uniform(low, high))
        if changed:
            changes[name] = settable(name, value)
    return changes | {name: value for name, value in storm().choices.items() if rng.random() < storm().share}


def second_storm_plant(number: int, seed: int, terrain: Terrain) -> dict[str, Any]:
    """Plant `number` of storm-2: the storm's parameters and the families', from seeds of their own."""
    changes = storm_plant(number, seed + 1, terrain) | further_changes(number, seed, terrain)
    if changes.get("sensor_jitter"):
        changes.pop("sensors", None)  # a lab's have a delay instead
    return changes


INSIDE: dict[str, dict[str, float]] = {
    **{f"scale-{scale:g}": {"mass_scale": scale} for scale in (0.5, 0.7, 1.0, 1.5, 2.0, 2.5, 3.0)},
    **{f"{kg}kg": {"payload": float(kg)} for kg in range(8, 73, 8)},
    "scale-2-power": {"mass_scale": 2.0, "motor_loss": 0.15},
    "scale-2-damping": {"mass_scale": 2.0, "joint_damping": 1.0},
    "scale-2-bend": {"mass_scale": 2.0, "link_bend": 0.05},
    "scale-2-bend-back": {"mass_scale": 2.0, "link_bend": -0.05},
}
BASES: dict[str, dict[str, float]] = {"scale-2": {"mass_scale": 2.0}, "40kg": {"payload": 40.0}}
OUTSIDE: dict[str, dict[str, Any]] = {
    **{f"ground-{text}": {"ground_stiffness": float(text)} for text in ("2e5", "5e4", "2e4")},
    **{f"friction-{value}": {"ground_friction": value} for value in (0.6, 0.4)},
    **{f"slope-{value}": {"slope": float(value)} for value in (1, 2, -1, -2, -4)},
    **{f"push-{value}": {"push": float(value)} for value in (10, 20)},
    **{f"coulomb-{value}": {"coulomb": float(value)} for value in (5, 10)},
    "unequal-motors": {"left_hip_gain": 0.8, "left_knee_gain": 1.0, "right_hip_gain": 1.1, "right_knee_gain": 0.9},
    "backlash-0.5": {"backlash": 0.5},
    "elastic-joints": {"gear_stiffness": 5000.0},
    "swing-payload": {"swing_payload": 10.0},
    "payload-ahead": {"payload": 10.0, "payload_ahead": 0.1},
    "left-leg-1.3": {"left_leg_scale": 1.3},
    **{f"delay-{ms}ms": {"torque_delay": ms / 1000} for ms in (4, 8)},
    **{f"noise-{value}": {"velocity_noise": value} for value in (0.1, 0.2)},
    "sensors-lab": {"sensors": "lab"},
}
OUTSIDE_STONES: dict[str, dict[str, Any]] = {
    **{f"height-{cm}cm": {"stone_height": cm / 100} for cm in (2, 4)},
    "height-1cm-unseen": {"stone_height": 0.01, "height_preview": False},
    "width-3cm": {"stone_width": 0.03},
}


@cache
def cells() -> dict[str, Cell]:
    """All, by name, in the order of tables and pictures."""
    listed: list[Cell] = []
    for terrain in TERRAINS:
        listed += (Cell(f"{terrain}/{name}", "inside", terrain, values) for name, values in INSIDE.items())
        changes = OUTSIDE | (OUTSIDE_STONES if terrain == "stones" else {})
        for base, masses in BASES.items():
            for name, values in changes.items():
                both = masses | values
                if name == "payload-ahead" and base == "40kg":
                    both = masses | {"payload_ahead": 0.1}
                listed.append(Cell(f"{terrain}/{base}-{name}", "outside", terrain, both))
        listed.append(Cell(f"{terrain}/storm", "storm", terrain))
        for name, family in families().families.items():
            if family.on(terrain):
                listed.append(Cell(f"{terrain}/{name}", family.split, terrain))
        listed.append(Cell(f"{terrain}/storm-2", "storm-2", terrain))
    return {cell.name: cell for cell in listed}


def chosen(patterns: Sequence[str]) -> list[Cell]:
    """Cells of these names, patterns (`flat/*`) or maps (`inside`), all where there are none; raises `CellError`."""
    names: set[str] = set()
    for pattern in patterns or ("*",):
        matching = [name for name, cell in cells().items() if fnmatchcase(name, pattern) or pattern == cell.map]
        if not matching:
            known = one_of(pattern, [*get_args(Map), *cells()])
            raise CellError(
                f"{pattern}: no such cells (--list has all): expected patterns, such as 'flat/*', or {known}"
            )
        names.update(matching)
    return [cell for name, cell in cells().items() if name in names]
