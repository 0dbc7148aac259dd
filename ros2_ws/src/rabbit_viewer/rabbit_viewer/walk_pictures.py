"""Pictures and film of a walk from what it left: a run's folder with its records, or a recording."""

from pathlib import Path
from typing import Any

from rabbit_description.bounded_file import exists
from rabbit_experiments.walk_records import (
    DRAWN_OF_PLANT,
    RECORDING,
    RECORDS,
    WalkRecords,
    drawn_parameters,
    load_records,
    walk_title,
)
from rabbit_recording.open_recording import beside
from rabbit_recording.reader import last_episode


def draw_pictures(source: Path, out: Path | None = None, episode: int | None = None, form: str = "png") -> list[Path]:
    """Draw into the folder `out`, by default SOURCE/pictures of a run and SOURCE-pictures of a recording.

    `episode`: of a recording, by default the last one with ticks; `form`: png, pdf or svg.

    Raises:
        RecordsError, RecordingError: not readable, or no such episode in it.
    """
    from rabbit_viewer.pictures import draw  # a played walk does without matplotlib

    return draw(records_of(source, episode), out or place_of(source, "pictures", "-pictures"), f".{form}")


def film_walk(
    source: Path, gif: bool = True, speed: float = 1.0, episode: int | None = None, beside: Path | None = None
) -> list[Path]:
    """Film into walk.mp4, and walk.gif, in a run's folder, or into SOURCE.mp4 next to a recording; another `beside`.

    Raises:
        RecordsError, RecordingError: as in `draw_pictures`.
        VideoError: the encoder failed.
    """
    from rabbit_viewer.video import film

    walks = [records_of(source, episode), *([records_of(beside)] if beside else [])]
    return film(walks, place_of(source, "walk.mp4", ".mp4"), speed, gif)


def records_of(source: Path, episode: int | None = None) -> WalkRecords:
    """The records of a run, or the ticks of an episode of its recording or of another; raises as `draw_pictures`."""
    is_run = exists(source / RECORDS) and episode is None
    return load_records(source / RECORDS) if is_run else records_of_bag(bag_of(source), episode)


def bag_of(source: Path) -> Path:
    """The recording: a run's, or what is given itself."""
    return source / RECORDING if exists(source / RECORDING) else source


def place_of(source: Path, name: str, suffix: str) -> Path:
    """A place for a picture: in a run's folder, or next to a recording."""
    is_run = exists(source / RECORDS)
    return source / name if is_run else beside(source, f"{source.resolve().stem}{suffix}")


def records_of_bag(bag: Path, number: int | None = None) -> WalkRecords:
    """The ticks of episode `number`, or of the last one that has some; raises `RecordingError`."""
    chosen = last_episode(bag, number)
    policies = ", ".join(dict.fromkeys(record.output.policy_version for record in chosen.records))
    drawn = [(settings.tick, drawn_parameters(settings.parameters)) for settings in chosen.settings]
    changed = ", ".join(f"parameters changed at tick {tick}" for tick, values in drawn if values != drawn[0][1])
    about = {"controller": chosen.controller, "policy": policies, "outcome": chosen.outcome, "seed": chosen.seed}
    about |= {**_plant_of_the_run(bag), **(drawn[0][1] if drawn else {})}
    about["tick_seconds"] = chosen.tick_seconds
    about["title"] = f"{walk_title(about)} (episode {chosen.number}{changed and ', ' + changed})"
    return WalkRecords.from_ticks(chosen.records, chosen.landings, about)


def _plant_of_the_run(bag: Path) -> dict[str, Any]:
    """A recording does not hold its plant: what the run in whose folder it lies says of it, if it lies in one."""
    folder = bag.resolve() if bag.is_dir() else bag.resolve().parent
    if folder.name != RECORDING or not (folder.parent / RECORDS).exists():
        return {}
    about = load_records(folder.parent / RECORDS).about
    return {name: about[name] for name in DRAWN_OF_PLANT if name in about}
