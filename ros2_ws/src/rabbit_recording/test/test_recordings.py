"""What a recording gives back: ticks, torques by replay, lost ticks, contents."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_recording.checking import check_episodes
from rabbit_recording.commands.bag import app
from rabbit_recording.contents import contents
from recorded_walk import SEED, TICK_NS, Walk, read_episodes
from rl_cbf_clf_controller.parameters import ControllerParameters
from typer.testing import CliRunner, Result

WriteBag = Callable[..., Path]


def rabbit(*words: object) -> Result:
    """`rabbit bag` in this process."""
    return CliRunner().invoke(app, [*map(str, words)])


def settled(parameters: ControllerParameters) -> Callable[[str, Any], Any]:
    """A change of a recording: it says that the controller went by other parameters."""

    def change(topic: str, message: Any) -> Any:
        if topic == "controller_settings":
            message.parameters = parameters.model_dump_json()
        return message

    return change


def test_ticks_come_back_bit_for_bit(tmp_path: Path, write_bag: WriteBag, walk: Walk) -> None:
    episode = read_episodes(write_bag(tmp_path / "bag"))[1]
    assert (episode.seed, episode.outcome, episode.lost) == (SEED, "walked", 0)
    assert episode.landings == walk.landings
    for ours, theirs in zip(episode.records, walk.records, strict=True):
        for name in ("tick", "q", "dq", "foot_force", "touchdowns", "preview", "applied"):
            np.testing.assert_array_equal(getattr(ours.state, name), getattr(theirs.state, name), name)
        for name in ("torque", "eta", "V", "mu", "alpha", "beta", "omega"):
            np.testing.assert_array_equal(getattr(ours.output, name), getattr(theirs.output, name), name)


def test_the_episodes_own_exploration_is_replayed(tmp_path: Path, write_bag: WriteBag, walk: Walk) -> None:
    quiet = settled(walk.parameters.model_copy(update={"sigma": 0.0}))

    def announce(topic: str, message: Any) -> Any:
        if topic == "episode":
            message.sigma = walk.parameters.sigma
        return quiet(topic, message)

    (checked,) = check_episodes(write_bag(tmp_path / "bag", change=announce))
    assert checked.differing == []


def test_lost_ticks_are_counted(tmp_path: Path, write_bag: WriteBag, walk: Walk) -> None:
    lost = {"torque": (5, 6), "controller_state": (6, 9), "state": (20,)}
    bag = write_bag(tmp_path / "bag", change=lambda t, m: None if t in lost and m.tick in lost[t] else m)
    (checked,) = check_episodes(bag)
    assert (checked.episode.lost, checked.replayed, checked.differing) == (4, 5, [])


def test_check_takes_the_recorded_parameters(tmp_path: Path, write_bag: WriteBag, walk: Walk) -> None:
    bag = write_bag(tmp_path / "bag")
    done = rabbit("check", bag)
    assert done.exit_code == 0, done.output
    assert f"{len(walk.records)} ticks, 0 lost, {len(walk.records)} replayed, torques identical" in done.output
    other = settled(walk.parameters.model_copy(update={"sigma": 0.5}))
    done = rabbit("check", write_bag(tmp_path / "other", change=other))
    assert done.exit_code == 1
    assert "torques differ" in done.output


def test_info_counts(tmp_path: Path, write_bag: WriteBag, walk: Walk) -> None:
    bag = write_bag(tmp_path / "bag")
    found, n = contents(bag), len(walk.records)
    counts = {topic.name: topic.messages for topic in found.topics}
    assert (counts["/state"], counts["/torque"], counts["/landing"], counts["/episode"]) == (n, n, 2, 2)
    assert found.messages == sum(counts.values())
    assert found.seconds == pytest.approx(n * TICK_NS / 1e9)
    assert {topic.qos for topic in found.topics} == {"reliable, transient local, last 20"}
    (episode,) = found.episodes
    assert (episode.seed, episode.recorded, episode.outcome, episode.policies) == (SEED, n, "walked", ["zero"])
    assert json.loads(rabbit("info", bag, "--json").output) == asdict(found)
    assert "walked" in rabbit("info", bag).output
