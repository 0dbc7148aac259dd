"""Pictures and film of a walk from its recording."""

from pathlib import Path

from rabbit_recording.bag_writer import RecordingError
from rabbit_recording.reader import RecordedEpisode, iterate_episodes

from rabbit_viewer.pictures import draw
from rabbit_viewer.video import as_gif, film
from rabbit_viewer.walk_records import WalkRecords, drawn_parameters


def draw_bag(bag: Path, out: Path | None = None, number: int | None = None) -> list[Path]:
    """Draw an episode (by default the last one with ticks) into the folder `out` (by default BAG-pictures).

    Raises:
        RecordingError: not readable, or no such episode in it.
    """
    return draw(records_of_bag(bag, number), out or bag.with_name(f"{bag.resolve().stem}-pictures"))


def film_bag(bag: Path, gif: bool = True, speed: float = 1.0, number: int | None = None) -> list[Path]:
    """Film an episode (by default the last one with ticks) into BAG.mp4, and BAG.gif, beside the recording.

    Raises:
        RecordingError: not readable, or no such episode in it.
        VideoError: the encoder failed.
    """
    made = [film(records_of_bag(bag, number), bag.with_name(f"{bag.resolve().stem}.mp4"), speed)]
    return [*made, as_gif(made[0])] if gif else made


def records_of_bag(bag: Path, number: int | None = None) -> WalkRecords:
    """The ticks of episode `number`, or of the last one that has some; raises `RecordingError`."""
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
    if chosen.settings:
        about |= drawn_parameters(chosen.settings[0].parameters)
    return WalkRecords.from_ticks(chosen.records, chosen.landings, about)
