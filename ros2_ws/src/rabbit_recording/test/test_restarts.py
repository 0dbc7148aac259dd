"""Recordings begun late, with a simulator or controller started again, settings changed, two controllers."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rabbit_recording import RecordingError
from rabbit_recording.active_settings import Policies, Settings
from rabbit_recording.checking import check_episodes, replayed
from rabbit_recording.commands.bag import app
from rabbit_recording.message_header import SimulatedTime
from recorded_walk import CONTROLLER, DRAWS, TICK_NS, TYPES, Walk, message, read_episodes, state_message, told, write
from rl_cbf_clf_controller.parameters import ControllerParameters
from typer.testing import CliRunner


def first_word() -> Any:
    """Of a simulator that waits."""
    waiting = {"seed": 0, "stones": 2, "reason": "", "policy_version": "", "sigma": float("nan"), "outcome": ""}
    return message("episode", 0, **{**waiting, "episode": 0, "phase": 0, "touchdowns": 0})


@pytest.mark.parametrize("command", ["info", "check", pytest.param("plot", marks=DRAWS)])
def test_a_recording_of_two_simulators_is_refused(tmp_path: Path, walk: Walk, command: str) -> None:
    """The same walk by two, as a recorder that does not look stores it: the second behind the first."""
    messages, began, bag = [], 0, tmp_path / "bag"
    for run in range(2):
        messages.append(("episode", began, first_word()))
        once = ("policy_swap", "controller_settings") if run else ()
        messages += [(topic, began + tick * TICK_NS, what) for topic, tick, what in told(walk) if topic not in once]
        began += (len(walk.records) + 2) * TICK_NS
    done = CliRunner().invoke(app, [command, str(write(bag, messages))])
    assert done.exit_code == 2
    assert f"recording {bag}: the simulator was started again without a memory" in " ".join(done.output.split())


def test_a_recorder_ends_where_another_simulator_begins(tmp_path: Path, walk: Walk) -> None:
    """By the first state that goes back behind a first word; one that goes on shows that the word was latched."""
    states = [state_message(record.state) for record in walk.records[:3]]
    data = [bytes(TYPES.serialize_cdr(state, "rabbit_msgs/msg/RobotState")) for state in states]
    word = bytes(TYPES.serialize_cdr(first_word(), "rabbit_msgs/msg/Episode"))
    time = SimulatedTime(tmp_path)
    for topic, stored in (("episode", word), ("state", data[0]), ("state", data[1]), ("episode", word)):
        time.of(topic, "simulator", stored)
    assert time.of("state", "simulator", data[2]) == 2 * TICK_NS
    assert time.of("state", "simulator", data[0]) == 0  # without a first word it is somebody else's
    time.of("state", "simulator", data[2])
    time.of("episode", "simulator", word[:20])  # cut, it reads as one
    time.of("state", "simulator", data[0][:20])
    time.of("state", "simulator", data[2])
    time.of("episode", "simulator", word)
    with pytest.raises(RecordingError, match="the simulator was started again without a memory"):
        time.of("state", "simulator", data[0])


def test_settings_changed_in_an_episode_are_replayed(tmp_path: Path, write_bag: Any, walk: Walk) -> None:
    """Told of another sigma from the last tick on: all torques but the last come out again, by what is recorded."""
    bag = write_bag(tmp_path / "bag")
    episode = read_episodes(bag)[1]
    last = walk.records[-1].state.tick
    (settings,) = episode.settings
    quiet = settings.parameters.model_copy(update={"sigma": 0.0})
    episode.settings.append(replace(settings, tick=last, parameters=quiet))
    again = [output.torque for _, output in replayed(episode)]
    same = [np.array_equal(r.output.torque, torque) for r, torque in zip(episode.records, again, strict=True)]
    assert [r.state.tick for r, is_same in zip(episode.records, same, strict=True) if not is_same] == [last]


OTHER = "/other fedcba9876543210"


def told_by_two(walk: Walk, is_other_first: bool) -> Iterator[tuple[str, int, Any]]:
    """Another controller tells its settings and answers each tick, with other torques, before or after the first."""
    settings = walk.parameters.model_copy(update={"eps": 0.5}).model_dump_json()
    for topic, tick, what in told(walk):
        others: list[tuple[str, int, Any]] = []
        if topic == "controller_settings":
            others = [(topic, tick, replace(what, parameters=settings, sender=OTHER))]
        elif topic == "torque":
            others = [(topic, tick, replace(what, torque=what.torque + 10, sender=OTHER))]
        elif topic == "controller_state":
            others = [(topic, tick, replace(what, mu=what.mu + 1, sender=OTHER))]
        elif topic == "learner_terms":
            others = [(topic, tick, replace(what, mu_qp=what.mu_qp + 1, sender=OTHER))]
        both = [*others, (topic, tick, what)] if is_other_first else [(topic, tick, what), *others]
        yield from ((topic, tick * TICK_NS, what) for topic, tick, what in both)


@pytest.mark.parametrize("is_other_first", [True, False])
def test_the_torques_that_acted_are_read(tmp_path: Path, walk: Walk, is_other_first: bool) -> None:
    (checked,) = check_episodes(write(tmp_path / "bag", told_by_two(walk, is_other_first)))
    episode = checked.episode
    assert (episode.controller, episode.lost, checked.differing) == (CONTROLLER, 0, [])
    for name in ("torque", "mu", "mu_qp"):
        recorded = [getattr(record.output, name) for record in episode.records]
        np.testing.assert_array_equal(recorded, [getattr(record.output, name) for record in walk.records])


def test_a_tick_that_only_the_other_answered_is_lost(tmp_path: Path, walk: Walk) -> None:
    def spoilt() -> Iterator[tuple[str, int, Any]]:
        for topic, tick, what in told(walk):
            if topic == "episode":
                what = replace(what, refused_controller=OTHER)
            is_others = (topic, tick) == ("torque", 30)
            yield topic, tick * TICK_NS, replace(what, sender=OTHER) if is_others else what

    (checked,) = check_episodes(write(tmp_path / "bag", spoilt()))
    assert (checked.episode.lost, checked.episode.refused_controller) == (1, OTHER)
    assert 30 not in [record.state.tick for record in checked.episode.records]


def told_settings(episode: int, tick: int, eps: float) -> Any:
    """What the controller says that it goes by."""
    parameters = ControllerParameters(eps=eps)
    gait = load_gait(parameters.gait).model_dump_json()
    what = message("controller_settings", tick, parameters=parameters.model_dump_json(), gait=gait)
    what.episode = episode
    return what


def in_force(settings: Settings, episode: int) -> list[tuple[int, float]]:
    """From which tick which eps holds."""
    return [(change.tick, change.parameters.eps) for change in settings.of(episode)]


def test_a_controller_started_again_holds_from_the_next_episode_on() -> None:
    told_so_far = Settings()
    told_so_far.add(told_settings(0, 0, 0.1), (0, 0))
    told_so_far.add(told_settings(2, 5, 0.2), (2, 4))
    told_so_far.add(told_settings(0, 0, 0.3), (3, 7))
    assert in_force(told_so_far, 2) == [(0, 0.1), (5, 0.2)]
    assert in_force(told_so_far, 3) == [(0, 0.2)]
    assert in_force(told_so_far, 4) == [(0, 0.3)]


LATE = 40  # tick


def test_check_replays_what_begins_and_says_why_not_the_rest(tmp_path: Path, walk: Walk) -> None:
    """The walk as episode 3 from tick 40 on and as episode 4, recorded late: settings and policy came as history."""
    n, messages = len(walk.records), []
    for episode in (1, 2, 3, 4):
        for topic, tick, what in told(walk):
            is_history = topic in ("controller_settings", "policy_swap")
            is_live = episode == 4 or (episode == 3 and tick >= LATE)
            if episode > 1 if is_history else not is_live and topic != "episode":
                continue
            what.episode = 0 if is_history else episode
            at = ((episode - 1) * (n + 1) + tick) * TICK_NS
            what.header.stamp.sec, what.header.stamp.nanosec = divmod(at, 10**9)
            messages.append((topic, at, what))
    done = CliRunner().invoke(app, ["check", str(write(tmp_path / "bag", messages))])
    assert done.output.splitlines() == [
        f"episode 3: {n - LATE} ticks, 0 lost, 0 replayed, a replay begins at tick 0, which is not in it",
        f"episode 4: {n} ticks, 0 lost, {n} replayed, torques identical",
    ]
    assert done.exit_code == 0


def test_a_controller_that_is_started_again_takes_no_policy_away() -> None:
    """Episode 1 was walked with zero, episode 2 with another; then a new controller said zero once more."""
    policies = Policies()
    for version in ("zero", "one", "zero"):
        policies.add(SimpleNamespace(version=version, accepted=True, data=version.encode()))
    policies.forget_before("zero")  # episode 1 is decoded now
    assert policies.get("one") == b"one"
