"""What both launchers say of a walk, and what they leave: a line an episode, the summary, the exit code."""

import contextlib
import sys
from collections.abc import Callable
from typing import Any

from rabbit_cli import exit_codes
from rabbit_cli.executables import LaunchError
from rabbit_cli.exit_codes import ExitCode
from rabbit_recording.bag_writer import RecordingError

from rabbit_bringup.launching.walk import Interrupted, Walk

Ended = Callable[[Any], None]  # gets the `Episode` message of an episode that has ended


def carry_out(walk: Walk, run: Callable[[Ended], tuple[list[Any], float]]) -> int:
    """Walk as `run` does, say how it went, and leave the summary; returns the exit code."""
    outcomes: list[str] = []

    def tell(episode: Any) -> None:
        outcomes.append(episode.outcome)
        print(line(episode), flush=True)

    try:
        seconds = run(tell)[1]
    except Interrupted as error:
        complain(f"stopped by {error}; what was recorded is in {walk.folder}")
        return error.code
    except LaunchError as error:
        return _fail(walk, error)
    code = exit_codes.of_walk(outcomes)
    if walk.options.record != "none":
        _leave(walk, code, seconds)
    counted = exit_codes.counted(outcomes)
    print(f"written to {walk.folder}")
    print(f"{code.word}: {counted.count('walked')} of {len(counted)} episodes walked", flush=True)
    return code


def line(episode: Any) -> str:
    """How an episode ended."""
    reason = f" ({episode.reason})" if episode.reason else ""
    stones = f"{episode.touchdowns - (episode.outcome == 'miss')} of {episode.stones} stones"
    return f"episode {episode.episode}, seed {episode.seed}: {episode.outcome}{reason}, {stones}, {episode.tick} ticks"


def complain(text: object) -> None:
    """One line on stderr."""
    print("rabbit:", " ".join(str(text).split()), file=sys.stderr, flush=True)


def _leave(walk: Walk, code: ExitCode, seconds: float) -> None:
    """Summary, pictures and film from the recording."""
    from rabbit_bringup.launching.walk_results import write_summary

    try:
        summary = write_summary(walk, walk.folder / "recording", code, seconds)
    except RecordingError as error:
        complain(error)
        return
    print(f"{summary['ticks']} ticks in {seconds:.1f} s: {summary['real_time_factor'] or 0:.1f} times real time")
    if timing := summary["real_time"]:
        print(
            f"real time: {timing['late_share']:.2%} of the ticks more than 2 ms late, {timing['missed']} unanswered in "
            f"time; age of the torque {timing['age_ms']['p99']:.1f} ms (p99)"
        )
    if summary["ticks"]:
        _draw(walk)


def _draw(walk: Walk) -> None:
    from rabbit_viewer.walk_pictures import draw_pictures, film_walk
    from rich.console import Console

    with Console().status("drawing"):
        if walk.options.pictures:
            draw_pictures(walk.folder)
        if walk.options.video:
            film_walk(walk.folder)


def _fail(walk: Walk, error: LaunchError) -> int:
    """The graph did not come to its end: say why, and summarise what it recorded until then."""
    recording = walk.folder / "recording"
    if not recording.exists():
        complain(error)
        with contextlib.suppress(OSError):  # nothing was left in it
            walk.folder.rmdir()
        return error.code
    from rabbit_recording.open_recording import opened
    from rabbit_recording.recover import recover

    from rabbit_bringup.launching.walk_results import write_summary

    note = ""
    try:
        with contextlib.suppress(RecordingError), opened(recording):
            note = f"what was recorded until then: {recording}"
        if not note:
            note = f"unfinished: {recording}; `rabbit bag recover {recording}` makes a whole one of it"
            recording = recover(recording).path
            note += f", as {recording}"
        write_summary(walk, recording, error.code, None, str(error))
    except RecordingError as unreadable:
        note = note or str(unreadable)
    complain(f"{error}; {note}")
    return error.code
