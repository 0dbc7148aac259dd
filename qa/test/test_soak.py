"""Does a soak find what grows, leaks, slows down, falls or is not answered, and only that?"""

import json
from typing import Any

import numpy as np
import pytest
from rabbit_campaigns.soak import LAUNCHER, judge

NODES = ("simulator", "controller", LAUNCHER)
SECONDS = np.arange(0.0, 3600.0, 5.0)


def samples(**of_controller: Any) -> dict[str, np.ndarray]:
    """An hour at 100 ticks/s and, on average, 2 ms of processor time a tick; other work moves it by a tenth."""
    noise = np.cumsum(1 + 0.1 * np.random.default_rng(1).standard_normal(len(SECONDS))) / len(SECONDS)
    steady = {"memory": 100.0 + 0 * SECONDS, "descriptors": 17 + 0 * SECONDS, "threads": 16 + 0 * SECONDS}
    columns: dict[str, np.ndarray] = {"seconds": SECONDS, "ticks": 100 * SECONDS, "episode": SECONDS // 60}
    columns["load"] = 1 + 0 * SECONDS
    for node in NODES:
        own = steady | {"cpu": 0.001 * 100 * SECONDS[-1] * noise} | (of_controller if node == "controller" else {})
        columns |= {f"{node}_{what}": values for what, values in own.items()}
    return columns


def test_a_steady_hour_keeps_every_bar() -> None:
    figures = judge(samples())
    assert all(figures["bars_kept"].values())
    assert figures["cpu_ms_per_tick"] == pytest.approx(2.0, rel=0.02)
    drift, low, high = figures["cpu_drift"]
    assert low <= drift <= high
    assert json.loads(json.dumps(figures)) == figures


@pytest.mark.parametrize(
    ("bar", "grows"),
    [
        ("memory", {"memory": 100.0 + SECONDS / 1000}),
        ("descriptors", {"descriptors": 17 + SECONDS // 1000}),
        ("threads", {"threads": 16 + SECONDS // 1000}),
        ("rate", {"cpu": 0.1 * SECONDS * (1 + SECONDS / 7200)}),
    ],
)
def test_what_grows_breaks_its_own_bar_alone(bar: str, grows: dict[str, np.ndarray]) -> None:
    kept = judge(samples(**grows))["bars_kept"]
    assert [name for name, holds in kept.items() if not holds] == [bar]
