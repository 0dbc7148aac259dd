"""Does a soak find what grows, leaks, slows down, falls or is not answered, and only that?"""

import json
from typing import Any

import numpy as np
import pytest
from rabbit_campaigns.soak import LAUNCHER, judge
from rabbit_campaigns.soak_operations import idle_policy, judge_walk
from rabbit_description.gait import load_gaits
from rabbit_recording.reader import RecordedEpisode
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.parameters import ControllerParameters

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


def test_a_walk_that_other_work_slows_has_no_drift() -> None:
    """2 ms a tick and 40 ms a second, both constant, as the rate falls from 20 to 7 ticks/s."""
    busy = samples()
    busy["ticks"] = np.cumsum(5 * np.linspace(20, 7, len(SECONDS)))
    for node in NODES:
        busy[f"{node}_cpu"] = 0.002 * busy["ticks"] + 0.04 * SECONDS
    figures = judge(busy)
    assert abs(figures["cpu_drift"][0]) < 0.01
    assert figures["bars_kept"]["rate"]


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


def episodes(*ends: tuple[str, str]) -> list[RecordedEpisode]:
    """Episodes with these outcomes and reasons, and behind them the one that the end of the soak cuts off."""
    cut = ("reset", "the simulator was told to end")
    return [RecordedEpisode(i, outcome=o, reason=r) for i, (o, r) in enumerate((*ends, cut), start=1)]


WALKED, RESET, FAULT = ("walked", ""), ("reset", "by service"), ("fault", "policy  was refused")


def test_all_episodes_walk_but_those_that_the_operator_ended() -> None:
    walks = judge_walk(episodes(WALKED, RESET, WALKED), resets=1)["walks"]
    assert walks == {"ended": 3, "walked": 2, "reset": 1, "fell": []}


@pytest.mark.parametrize("end", [FAULT, ("fall", ""), ("silent", ""), ("reset", "the simulator was started again")])
def test_what_did_not_walk_is_named(end: tuple[str, str]) -> None:
    assert judge_walk(episodes(WALKED, end, WALKED), resets=1)["walks"]["fell"] == [[2, 0, *end]]


def test_the_policy_of_a_soak_fits_and_estimates_nothing() -> None:
    parameters = ControllerParameters(controller="rl-cbf-clf-qp", adaptation="identification", gait="paper_stones")
    file = idle_policy(parameters)
    estimates = fitted(file, parameters, load_gaits(parameters.gait)).act(
        np.ones(len(file.metadata.observation)), np.ones(4)
    )
    assert not estimates.alpha.any()
    assert not estimates.beta.any()
