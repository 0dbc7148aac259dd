"""Uncertainty of structure: families of plants that no parameter of a rigid robot describes, split in five.

Methods may be tuned and trained on the `development` families. The `reported` ones are for the table alone: nothing
was trained, tuned or chosen on their reported plants. The `unseen` ones were walked once, when all controllers were as
they are. The `unseen-2` and `contact` ones wait for that; the ground of the latter is what is strange. A plant of a
family has a mass scale and the family's own values, each uniform within its range. `storm-2` draws from the storm and
from the families of the first two kinds.
"""

import zlib
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field
from rabbit_description.validation import Checked
from rabbit_description.yaml_file import parse_yaml
from rabbit_sim.parameters import marked
from rabbit_sim.perturbation import WHOLE_SUBSTEPS

Split = Literal["development", "reported", "unseen", "unseen-2", "contact"]
Value = float | int
Range = tuple[Value, Value]  # of two whole numbers: whole numbers between them


def in_order(listed: Any) -> Any:
    """A list of [name, value, ...] as a dictionary in its order, which a mapping's keys would not decide."""
    if not isinstance(listed, list) or not all(isinstance(item, list) and item for item in listed):
        raise ValueError("expected a list of [name, value, ...], in the order of drawing")
    return {name: value if len(value) > 1 else value[0] for name, *value in listed}


def by_name(listed: Any) -> Any:
    """A list of mappings as a dictionary in its order, by their `name`."""
    if not isinstance(listed, list):
        raise ValueError("expected a list of families, in the order of drawing")
    return {item.get("name"): {key: value for key, value in item.items() if key != "name"} for item in listed}


Ranges = Annotated[dict[str, Range], BeforeValidator(in_order)]


class Family(Checked):
    """One of families.yaml: ranges on each terrain that has it."""

    split: Split
    stones: Ranges | None = None
    flat: Ranges | None = None

    def on(self, terrain: str) -> dict[str, Range] | None:
        """Ranges by parameter."""
        return self.stones if terrain == "stones" else self.flat


class Families(Checked):
    """What families.yaml says; `share`: with which probability a plant of storm-2 is of a family."""

    every: Ranges
    share: Annotated[float, Field(gt=0, le=1)]
    families: Annotated[dict[str, Family], BeforeValidator(by_name)]


@cache
def families() -> Families:
    """The committed ranges."""
    return Families.model_validate(parse_yaml((files(__package__) / "families.yaml").read_text(encoding="utf-8")))


def family_plant(name: str, number: int, seed: int, terrain: str) -> dict[str, Any]:
    """Plant `number` of a family, the same for the same arguments on every machine."""
    rng = np.random.default_rng([seed, number, zlib.crc32(f"{terrain}/{name}".encode())])
    return drawn(families().every, rng) | drawn(families().families[name].on(terrain) or {}, rng)


def further_changes(number: int, seed: int, terrain: str) -> dict[str, Any]:
    """What plant `number` of storm-2 has beside the storm's changes."""
    rng = np.random.default_rng([seed, number, zlib.crc32(f"{terrain}/storm-2".encode())])
    changes: dict[str, Any] = {}
    for family in families().families.values():
        if family.split not in ("development", "reported"):
            continue
        values, is_in_it = drawn(family.on(terrain) or {}, rng), rng.random() < families().share
        if is_in_it:
            changes |= values
    return changes


def drawn(ranges: dict[str, Range], rng: "np.random.Generator") -> dict[str, Value]:
    """A value of each range."""
    values: dict[str, Value] = {}
    for name, (low, high) in ranges.items():
        if isinstance(low, int) and isinstance(high, int):
            values[name] = int(rng.integers(low, high + 1))
        else:
            values[name] = settable(name, rng.uniform(low, high))
    return values


def settable(name: str, value: float) -> float:
    """A drawn value as a plant takes it: some times are whole milliseconds."""
    return round(float(value), 3) if name in marked(WHOLE_SUBSTEPS) else float(value)
