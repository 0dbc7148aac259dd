"""Is a recording read rightly? `rabbit bag info` and `check` must say what a witness heard meanwhile."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rabbit_recording import RecordingError
from rabbit_recording.checking import Checked, check_episodes
from rabbit_recording.contents import contents
from rabbit_recording.episode_inventory import EpisodeInventory, Presence

Turn = tuple[int, int]  # episode and tick


@dataclass(frozen=True)
class MonitorRecord:
    """By the witness.

    `wanted`: ticks of which it heard state, torque and controller state while the recorder was there, but for a killed
    one's last second. `ever`: all of which it heard the state since the graph began; a controller that has just been
    started may not know of the witness yet.
    `ended`: the episodes that ended meanwhile, with their outcomes. `is_cut`: the recorder was killed.
    `halved`: ticks in which a sender was killed. It may have sent such a tick to one reader and not to the next.
    """

    wanted: frozenset[Turn]
    ever: frozenset[Turn]
    ended: dict[int, str]
    is_cut: bool
    halved: frozenset[Turn] = frozenset()


def misreadings(path: Path, heard: MonitorRecord) -> list[str]:
    """What is read of a recording and was not so; empty if all is right."""
    try:
        listed, checked = contents(path).episodes, list(check_episodes(path))
    except RecordingError as error:
        return [str(error)]
    return [*_of_info(listed, checked, heard), *(text for each in checked for text in _of_check(each, checked, heard))]


def _of_info(listed: list[EpisodeInventory], checked: list[Checked], heard: MonitorRecord) -> Iterator[str]:
    """Episodes and ticks are those that were heard."""
    found = [account for account in listed if account.presence is Presence.RECORDED]
    yield from (f"info: episode {a.number} is lost" for a in listed if a.presence is Presence.LOST)
    numbers = [account.number for account in found]
    if numbers != [each.episode.number for each in checked]:
        yield f"info lists episodes {numbers}, check others"
    if absent := {episode for episode, _ in heard.wanted} - set(numbers):
        yield f"info: no episode {sorted(absent)}"
    there = {(each.episode.number, record.state.tick) for each in checked for record in each.episode.records}
    if missing := heard.wanted - there:
        yield f"{len(missing)} ticks are not read, the first {min(missing)}"
    if invented := there - heard.ever:
        yield f"{len(invented)} ticks were never heard, the first {min(invented)}"
    outcomes = {account.number: account.outcome for account in found if account.ends}
    for number, outcome in heard.ended.items():
        if outcomes.get(number) != outcome:
            yield f"info: episode {number} ended as {outcomes.get(number)}, expected {outcome}"
    for account in found:
        if account.recorded != sum(episode == account.number for episode, _ in there):
            yield f"info: episode {account.number} has {account.recorded} ticks, check others"


def _of_check(each: Checked, checked: list[Checked], heard: MonitorRecord) -> Iterator[str]:
    """Nothing is lost but with a killed sender, and at a killed recorder's end; from tick 0 on all ticks replay."""
    episode = each.episode
    halved = sum(number == episode.number for number, _ in heard.halved)
    if episode.lost > halved and not (heard.is_cut and each is checked[-1]):
        yield f"check: episode {episode.number} has lost {episode.lost} ticks"
    if each.differing:
        yield f"check: episode {episode.number} does not replay at ticks {each.differing[:3]}"
    if episode.begins and not episode.lost and each.replayed != episode.recorded:
        yield f"check: episode {episode.number} has {episode.recorded} ticks, {each.replayed} were replayed"
