"""Recordings in which the simulator was started again or settings changed."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_recording.bag_writer import BagWriter
from rabbit_recording.checking import check_episodes, replay
from rabbit_recording.commands.bag import app
from rabbit_recording.contents import contents
from rabbit_recording.reader import read_episodes
from recorded_walk import LATCHED, SEED, TICK_NS, TOPICS, TYPES, Walk, message, told
from typer.testing import CliRunner

RUNS = 2


@pytest.fixture
def restarted(tmp_path: Path, walk: Walk) -> Path:
    """The same walk in each of two runs of the simulator; the controller goes on and is heard once."""
    writer = BagWriter(tmp_path / "bag", TYPES)
    for topic, name in TOPICS.items():
        writer.add(f"/{topic}", f"rabbit_msgs/msg/{name}", [LATCHED])

    def write(topic: str, nanoseconds: int, what: Any) -> None:
        data = bytes(TYPES.serialize_cdr(what, f"rabbit_msgs/msg/{TOPICS[topic]}"))
        writer.write(f"/{topic}", nanoseconds, data)

    began = 0
    for run in range(RUNS):
        waiting = {"seed": 0, "stones": 2, "reason": "", "policy_version": "", "sigma": float("nan"), "outcome": ""}
        write("episode", began, message("episode", 0, **{**waiting, "episode": 0, "phase": 0, "touchdowns": 0}))
        for topic, tick, what in told(walk):
            if run == 0 or topic not in ("policy_swap", "controller_settings"):
                write(topic, began + tick * TICK_NS, what)
        began += (len(walk.records) + 2) * TICK_NS
    writer.close()
    return tmp_path / "bag"


def test_episodes_of_a_second_run_count_on(restarted: Path, walk: Walk) -> None:
    found = read_episodes(restarted)
    assert list(found) == [1, 2]
    for episode in found.values():
        assert (episode.seed, episode.outcome, len(episode.records)) == (SEED, "walked", len(walk.records))
        assert episode.landings == walk.landings
    assert [(e.number, e.run, e.seed, e.outcome) for e in contents(restarted).episodes] == [
        (1, 0, SEED, "walked"),
        (2, 1, SEED, "walked"),
    ]


def test_both_runs_replay_without_a_parameter_file(restarted: Path, walk: Walk) -> None:
    checked = list(check_episodes(restarted))
    assert [(c.episode.number, c.episode.lost, c.replayed, c.differing) for c in checked] == [
        (number, 0, len(walk.records), []) for number in (1, 2)
    ]


def test_the_commands_know_of_the_restart(restarted: Path) -> None:
    rabbit: Callable[..., Any] = lambda *words: CliRunner().invoke(app, [*map(str, words)])  # noqa: E731
    info = rabbit("info", restarted).output
    assert "started anew 1 times" in info
    assert rabbit("plot", restarted, "--episode", 2).exit_code == 0
    assert rabbit("plot", restarted, "--episode", 3).exit_code == 2


def test_settings_changed_in_an_episode_are_replayed(tmp_path: Path, write_bag: Any, walk: Walk) -> None:
    """Told of another sigma from the last tick on: all torques but the last come out again, by what is recorded."""
    bag = write_bag(tmp_path / "bag")
    episode = read_episodes(bag)[1]
    last = walk.records[-1].state.tick
    (settings,) = episode.settings
    quiet = settings.parameters.model_copy(update={"sigma": 0.0})
    episode.settings.append(replace(settings, tick=last, parameters=quiet))
    again = zip(episode.records, replay(episode), strict=True)
    assert [r.state.tick for r, torque in again if not np.array_equal(r.output.torque, torque)] == [last]


def test_a_torque_that_stood_in_is_replayed(tmp_path: Path, write_bag: Any, walk: Walk) -> None:
    """The controller hears in the state what acted: with another torque told there, mu_held is another."""

    def change(topic: str, what: Any) -> Any:
        if topic == "state" and what.tick == 10:
            what.applied = np.asarray(walk.records[8].output.torque)
        return what

    state = read_episodes(write_bag(tmp_path / "bag", change=change))[1].records[10].state
    assert np.array_equal(state.applied, walk.records[8].output.torque)
