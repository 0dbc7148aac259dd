"""The plants that the policy is trained on: the storm's, masses alone, and the development families."""

import math
from functools import cache
from typing import Any

import numpy as np
from rabbit_benchmark.cells import Terrain, storm
from rabbit_benchmark.families import drawn, families, settable
from rabbit_description.state import Array
from rabbit_sim.parameters import SimulationParameters

WALK_ALONE = {"gear_stiffness", "backlash", "coulomb", "joint_damping"}  # in a batch, so they are drawn less often
MASS_SCALES, PAYLOAD = (0.7, 2.5), 50.0  # kg
LAG, LAGS = 0.004, (0.0, 0.01)  # s
HARD = {"torque_rate": (5000.0, 16000.0), "loose_depth": (0.01, 0.04)}  # in place of the families' ranges


def draw_plant(terrain: Terrain, rng: "np.random.Generator", stones: int) -> SimulationParameters:
    """A plant of MuJoCo's: half of them stormy, half with a mass alone; of all six in ten are of a family."""
    changes: dict[str, Any] = {}
    if rng.random() < 0.5:
        for name, (low, high) in storm().on(terrain).items():
            value, share = float(rng.uniform(low, high)), 0.06 if name in WALK_ALONE else storm().share
            if rng.random() < share:
                changes[name] = settable(name, value)
    elif rng.random() < 0.6:
        changes["mass_scale"] = math.exp(rng.uniform(*np.log(MASS_SCALES)))
    else:
        changes["payload"] = rng.uniform(0, PAYLOAD)
    if rng.random() < 0.6:
        families_of = (family.on(terrain) for family in families().families.values() if family.split == "development")
        known = [ranges for ranges in families_of if ranges]
        ranges = known[rng.integers(len(known))]
        changes |= drawn({name: HARD.get(name, limits) for name, limits in ranges.items()}, rng)
    lag = LAG if rng.random() < 0.7 else rng.uniform(*LAGS)
    course = {"terrain": terrain, "stones": stones, "motor_lag": lag, "plant": "mujoco"}
    return SimulationParameters.model_validate(course | changes)


def described(plant: SimulationParameters) -> Array:
    """The drawn parameters, (k,): 0 for a default, else from 0.2 to 1 within the range. For the value network alone."""
    shares = []
    for name, (low, high) in sorted(ranges().items()):
        value = getattr(plant, name)
        is_default = value == SimulationParameters.model_fields[name].default
        shares.append(0.0 if is_default else 0.2 + 0.8 * (value - low) / (high - low))
    return np.array([*shares, float(plant.sensors != "exact")])


@cache
def ranges() -> dict[str, tuple[float, float]]:
    """The ranges of all that may be drawn."""
    limits = dict(storm().on("stones")) | {"motor_lag": LAGS}
    for family in families().families.values():
        if family.split == "development":
            limits |= {**(family.flat or {}), **(family.stones or {})}
    return limits | HARD
