"""Pictures of a walk from its recording."""

from pathlib import Path

from rabbit_bringup.recording.bag_writer import RecordingError
from rabbit_bringup.recording.reader import RecordedEpisode, iterate_episodes
from rabbit_bringup.viewing.pictures import draw
from rabbit_bringup.viewing.walk_records import WalkRecords


def draw_bag(bag: Path, out: Path | None = None, number: int | None = None) -> list[Path]:
    """Draw an episode (by default the last one with ticks) into the folder `out` (by default BAG-pictures).

    Raises:
        RecordingError: not readable, or no such episode in it.
    """
    chosen: RecordedEpisode | None = None
    for episode in iterate_episodes(bag):
        if episode.records and number in (None, episode.number):
            chosen = episode
    if chosen is None:
        raise RecordingError(f"recording {bag}: no ticks of {f'episode {number}' if number else 'a walk'} in it")
    policies = ", ".join(dict.fromkeys(record.output.policy_version for record in chosen.records))
    outcome = chosen.outcome or "not recorded to its end"
    title = f"episode {chosen.number}, policy {policies}, seed {chosen.seed}: {outcome}"
    about = {"title": title, "outcome": chosen.outcome, "seed": chosen.seed}
    return draw(
        WalkRecords.from_ticks(chosen.records, chosen.landings, about),
        out or bag.with_name(f"{bag.resolve().stem}-pictures"),
    )
