"""Reads a recording back into what a rollout in process gives: ticks and landings, by episode. No ROS needed."""

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.state import DOF, RobotState, StonePreview
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.message_fields import output_of
from rl_trainer.rollout import Record

from rabbit_recording import RecordingError
from rabbit_recording.active_settings import Policies, RecordedSettings, Settings
from rabbit_recording.episode_inventory import BY_TICK, DETAILS, OTHERS, EpisodeInventory, Gathered, Gathering, Presence
from rabbit_recording.message_header import SimulatedTime
from rabbit_recording.open_recording import one_line_errors
from rabbit_recording.stored_messages import stored_messages

UNDER_OTHERS = "recorded under other message definitions, or damaged"


@dataclass(frozen=True)
class RecordedSwap:
    """The policy that made the torques from `tick` on; `data`: empty for the built-in zero policy, None if unknown."""

    tick: int
    version: str
    data: bytes | None


@dataclass
class RecordedEpisode(EpisodeInventory):
    """One episode with its ticks in full.

    `sigma` is the exploration it was announced with, NaN for the controller's own parameter. `swaps` begin with the
    policy of its first recorded tick, `settings` with what the controller went by at its start.
    """

    sigma: float = math.nan
    records: list[Record] = field(default_factory=list)
    landings: list[Landing] = field(default_factory=list)
    swaps: list[RecordedSwap] = field(default_factory=list)
    settings: list[RecordedSettings] = field(default_factory=list)


def messages(path: Path, *names: str) -> Iterator[tuple[str, Any]]:
    """Topic (its last part) and message of this project's own types, in the order of time; all of them if no `names`.

    Raises `RecordingError`, as `stored_messages`.
    """
    with one_line_errors(path), stored_messages(path, *names) as found:
        for message in found:
            yield message.topic, message.decode()


def read_episodes(path: Path) -> dict[int, RecordedEpisode]:
    """All episodes that `iterate_episodes` gives, by number."""
    return {episode.number: episode for episode in iterate_episodes(path)}


def iterate_episodes(path: Path) -> Iterator[RecordedEpisode]:
    """One episode after another, the lost ones too; a long recording needs the memory of a few of them.

    Raises `RecordingError`, as `iterate_inventories`.
    """
    announced = _Announced()
    with one_line_errors(path, UNDER_OTHERS):
        for gathered, inventory in _finished(path, announced):
            if inventory.presence is not Presence.ANNOUNCED:
                yield _decoded(gathered, inventory, announced)


def last_episode(path: Path, number: int | None = None) -> RecordedEpisode:
    """Episode `number`, or the last one that has ticks; raises `RecordingError`."""
    chosen: RecordedEpisode | None = None
    for episode in iterate_episodes(path):
        if episode.records and number in (None, episode.number):
            chosen = episode
    if chosen is None:
        raise RecordingError(f"recording {path}: no ticks of {f'episode {number}' if number else 'a walk'} in it")
    return chosen


def iterate_inventories(path: Path) -> Iterator[EpisodeInventory]:
    """What the recording holds of each episode, also of those that were merely announced. No tick is decoded.

    Raises `RecordingError`, as `stored_messages`; or of messages that are defined otherwise than this version's.
    """
    with one_line_errors(path, UNDER_OTHERS):
        yield from (inventory for _, inventory in _finished(path))


@dataclass
class _Announced:
    """By the controller, so far."""

    policies: Policies = field(default_factory=Policies)
    settings: dict[str, Settings] = field(default_factory=lambda: defaultdict(Settings))  # by controller


def _finished(path: Path, announced: _Announced | None = None) -> Iterator[tuple[Gathered, EpisodeInventory]]:
    gathering, time = Gathering(), SimulatedTime(path)
    names = (*BY_TICK, *OTHERS, *(("policy_swap", "controller_settings") if announced else ()))
    with stored_messages(path, *names) as found:
        for message in found:
            time.follow(message.topic, message.data)
            if announced and message.topic == "policy_swap":
                announced.policies.add(message.decode())
            elif announced and message.topic == "controller_settings":
                said = message.decode()
                announced.settings[said.sender].add(said, gathering.newest)
            else:
                gathering.add(message)
                yield from gathering.finished()
        yield from gathering.finished(all_of_them=True)


def _decoded(gathered: Gathered, inventory: EpisodeInventory, announced: _Announced) -> RecordedEpisode:
    """The episode in full; what only it needed is forgotten."""
    episode = RecordedEpisode(**vars(inventory))
    if gathered.announced is not None:
        episode.sigma = gathered.announced.sigma
    ticks, controller = gathered.ticks, inventory.controller
    previews: dict[int, StonePreview | None] = {}  # as first seen, by index of the stone
    for tick in gathered.full_ticks(ticks):
        state, torque = (ticks[topic][tick].decode() for topic in ("state", "torque"))
        details, terms = (each and each.decode() for each in (ticks[topic].get(tick) for topic in DETAILS))
        if len(state.q) != DOF:
            raise RecordingError(
                f"{len(state.q)} coordinates: no robot of ours; of your own system `rabbit bag` plots, shows, checks "
                "and explains it with `--task`"
            )
        stone, version, controller = state.touchdowns + 1, torque.policy_version, torque.sender
        if stone not in previews:
            previews[stone] = gathered.preview(stone, ticks["state"][tick].stamp)
        measured = RobotState.of_message(state, previews[stone] if state.previewed else None)
        output = output_of(details, terms, np.array(torque.torque), measured, version)
        episode.records.append(Record(measured, output))
        if not episode.swaps or version != episode.swaps[-1].version:
            episode.swaps.append(RecordedSwap(tick, version, announced.policies.get(version)))
    for _, landing in sorted(gathered.landings.items()):
        episode.landings.append(Landing(**{name: getattr(landing, name) for name in Landing.__dataclass_fields__}))
    episode.controller, episode.settings = controller, announced.settings[controller].of(gathered.episode)
    if episode.swaps:
        announced.policies.forget_before(episode.swaps[-1].version)
    return episode
