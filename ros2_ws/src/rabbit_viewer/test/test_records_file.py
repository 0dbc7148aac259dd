"""A file of records: read, or refused in one line, whatever is in it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_experiments.walk_records import RecordsError, load_records

TICKS = 3
SHAPES: dict[str, tuple[int, ...]] = {
    **dict.fromkeys(("tick", "touchdowns", "stance", "step_index"), (TICKS,)),
    **dict.fromkeys(("stone_height", "phase", "V", "clf_slack", "rescue_slack"), (TICKS,)),
    **{"q": (TICKS, 7), "dq": (TICKS, 7), "foot_force": (TICKS, 2, 2), "contact": (TICKS, 2), "preview": (TICKS, 2)},
    **{"torque": (TICKS, 4), "eta": (TICKS, 8), "barriers": (TICKS, 2), "barrier_rates": (TICKS, 2)},
    **dict.fromkeys(("mu", "mu_qp", "omega", "mu_held", "LgV"), (TICKS, 4)),
    **dict.fromkeys(("nominal_a", "alpha"), (TICKS, 5, 4)),
    **dict.fromkeys(("nominal_b", "measured", "beta"), (TICKS, 5)),
    "landings": (0, 6),
}
WHOLE = ("tick", "touchdowns", "stance", "step_index")


def write(path: Path, about: Any = None, **arrays: Any) -> Path:
    """Records of zeros, but for `arrays`."""
    zeros = {name: np.zeros(shape, int if name in WHOLE else float) for name, shape in SHAPES.items()}
    words = json.dumps({} if about is None else about)
    with path.open("wb") as file:
        np.savez_compressed(file, about=np.array(words), **{**zeros, **arrays})
    return path


def test_sound_records_are_read(tmp_path: Path) -> None:
    assert len(load_records(write(tmp_path / "records.npz")).tick) == TICKS


@pytest.mark.parametrize(
    ("about", "arrays"),
    [
        ({}, {"q": np.zeros((TICKS, 6))}),
        ({}, {"V": np.zeros(TICKS + 1)}),
        ({}, {"stance": np.full(TICKS, 2)}),
        ({}, {"tick": np.zeros(TICKS)}),
        ({}, {"torque": np.array([["a"] * 4] * TICKS)}),
        ({"eps": 0.0}, {}),
        ({"link_bend": "x"}, {}),
        ({"R1": 1e300}, {}),
        ({"quantities": ["V"]}, {}),
        ([1], {}),
    ],
)
def test_what_does_not_fit_together_is_refused(tmp_path: Path, about: Any, arrays: dict[str, Any]) -> None:
    with pytest.raises(RecordsError, match="no records of a walk") as refused:
        load_records(write(tmp_path / "records.npz", about, **arrays))
    assert "\n" not in str(refused.value)
