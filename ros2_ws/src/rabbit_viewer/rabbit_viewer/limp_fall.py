"""How a robot that no controller moves any more falls to the ground, in `rabbit play` and after a recorded walk's end.

Nobody records what comes after the end of an episode. A film shows it all the same: computed from the last recorded
state, on the plant that walked.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import numpy as np
from pydantic import ValidationError
from rabbit_description.plugins import load
from rabbit_description.state import JOINTS, TICK_SECONDS, Leg
from rabbit_description.tick import ticks_in
from rabbit_experiments.walk_records import ARRAYS, PLANT, WalkRecords
from rabbit_sim.parameters import PLANTS, SimulationParameters
from rabbit_sim.plant import Plant, PlantReading, Span
from rabbit_sim.terrain import GROUND, KEPT_STONES

from rabbit_viewer.geometry import feet, links_of, stone_spans, torso_points

LIMP_SECONDS = 1.5  # at most
LYING = 0.2  # m, of hip or head above the ground
ON_ITS_FEET = ("", "walked", "reset", "diverged")  # outcomes of which no fall is computed
READ = ("q", "dq", "foot_force", "contact")
UNKNOWN = ("V", "clf_slack", "rescue_slack", "barriers", "margins")  # of a tick that no controller decided
COMPUTED_FROM = "computed_from"  # in `about`: the row


def fall_limp(plant: Plant, top: float, tick_seconds: float = TICK_SECONDS) -> Iterator[PlantReading]:
    """Each tick without torque, until hip or head lies on the ground, whose height is `top`, m."""
    for _ in range(ticks_in(LIMP_SECONDS, tick_seconds)):
        plant.advance(np.zeros(JOINTS))
        reading = plant.observe()
        yield reading
        if not torso_points(reading.q[None])[0, :, 1].min() - top > LYING:
            return


def with_fall(walk: WalkRecords) -> WalkRecords:
    """The walk and the fall after its end; the walk alone where it ended on its feet, or its plant is not known."""
    last = np.concatenate([walk.q[-1], walk.dq[-1], walk.torque[-1]])
    if walk.about.get("outcome", "") in ON_ITS_FEET or not np.isfinite(last).all():
        return walk
    try:
        parameters = SimulationParameters.model_validate(walk.about.get(PLANT))
    except ValidationError:
        return walk
    stones = _stones_underfoot(walk)
    with closing(load(PLANTS, parameters.plant)(parameters)) as plant:
        plant.reset(walk.q[-1], walk.dq[-1], Leg(walk.stance[-1]))
        plant.set_stones(stones)
        plant.advance(walk.torque[-1])
        readings = [plant.observe(), *fall_limp(plant, stones[-1].top, parameters.tick_seconds)]
    count = len(readings)
    longer = {name: np.repeat(getattr(walk, name)[-1:], count, axis=0) for name in ARRAYS if name != "landings"}
    longer |= {name: np.array([getattr(reading, name) for reading in readings]) for name in READ}
    longer |= {name: longer[name] * np.nan for name in UNKNOWN if name in longer}
    longer |= {"tick": walk.tick[-1] + 1 + np.arange(count), "torque": longer["torque"] * 0}
    arrays = {name: np.concatenate([getattr(walk, name), rows]) for name, rows in longer.items()}
    return replace(walk, **arrays, about={**walk.about, COMPUTED_FROM: len(walk.tick)})


def _stones_underfoot(walk: WalkRecords) -> list[Span]:
    """Those in reach at the end; none is higher than a foot that stands on it, whose stone may have given way."""
    places = feet(walk.q, links_of(walk.about))
    spans, last = (stone_spans(walk, places) or [GROUND])[-KEPT_STONES:], places[-1].tolist()
    return [span._replace(top=min([span.top, *(z for x, z in last if span.near <= x <= span.far)])) for span in spans]
