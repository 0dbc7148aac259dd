"""A recording that begins in the middle of a walk; settings and policies that came as history."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rabbit_description.gait import load_gait
from rabbit_recording.active_settings import Policies, Settings
from rabbit_recording.commands.bag import app
from recorded_walk import TICK_NS, Walk, message, told, write
from rl_cbf_clf_controller.parameters import ControllerParameters
from typer.testing import CliRunner


def told_settings(episode: int, tick: int, eps: float) -> Any:
    """What the controller says that it goes by."""
    parameters = ControllerParameters(eps=eps)
    gait = load_gait(parameters.gait).model_dump_json()
    what = message("controller_settings", tick, parameters=parameters.model_dump_json(), gait=gait)
    what.episode = episode
    return what


def in_force(settings: Settings, episode: int) -> list[tuple[int, float]]:
    """From which tick which eps holds."""
    return [(each.tick, each.parameters.eps) for each in settings.of(episode)]


def test_a_controller_started_again_holds_from_the_next_episode_on() -> None:
    told_so_far = Settings()
    told_so_far.add(told_settings(0, 0, 0.1), (0, 0))
    told_so_far.add(told_settings(2, 5, 0.2), (2, 4))
    told_so_far.add(told_settings(0, 0, 0.3), (3, 7))
    assert in_force(told_so_far, 2) == [(0, 0.1), (5, 0.2)]
    assert in_force(told_so_far, 3) == [(0, 0.2)]
    assert in_force(told_so_far, 4) == [(0, 0.3)]


@pytest.fixture
def late(tmp_path: Path, walk: Walk) -> Path:
    """The walk as episode 3 from tick 40 on and as episode 4, recorded late: settings and policy are history."""
    length, messages = (len(walk.records) + 1) * TICK_NS, []
    for episode in (1, 2, 3, 4):
        for topic, tick, what in told(walk):
            is_history = topic in ("controller_settings", "policy_swap")
            is_live = episode == 4 or (episode == 3 and tick >= LATE)
            if episode > 1 if is_history else not is_live and topic != "episode":
                continue
            what.episode = 0 if is_history else episode
            at = (episode - 1) * length + tick * TICK_NS
            what.header.stamp.sec, what.header.stamp.nanosec = divmod(at, 10**9)
            messages.append((topic, at, what))
    return write(tmp_path / "bag", messages)


LATE = 40  # tick


def test_check_replays_what_begins_and_says_why_not_the_rest(late: Path, walk: Walk) -> None:
    """The controller's settings came as history."""
    done = CliRunner().invoke(app, ["check", str(late)])
    n = len(walk.records)
    assert done.output.splitlines() == [
        f"episode 3: {n - LATE} ticks, 0 lost, 0 replayed, a replay begins at tick 0, which is not in it",
        f"episode 4: {n} ticks, 0 lost, {n} replayed, torques identical",
    ]
    assert done.exit_code == 0


def policy(version: str) -> SimpleNamespace:
    """An accepted policy, as the controller announces it."""
    return SimpleNamespace(version=version, accepted=True, data=version.encode())


def test_a_controller_that_is_started_again_takes_no_policy_away() -> None:
    """Episode 1 was walked with zero, episode 2 with another; then a new controller said zero once more."""
    policies = Policies()
    for version in ("zero", "one", "zero"):
        policies.add(policy(version))
    policies.forget_before("zero")  # episode 1 is decoded now
    assert policies.get("one") == b"one"


def test_what_was_told_before_is_forgotten() -> None:
    policies = Policies()
    for version in ("zero", "one", "two"):
        policies.add(policy(version))
    policies.forget_before("two")
    assert [policies.get(version) for version in ("zero", "one", "two")] == [None, None, b"two"]
