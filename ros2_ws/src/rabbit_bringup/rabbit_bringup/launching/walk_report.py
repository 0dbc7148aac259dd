"""What is said of a walk, and what it leaves: a line an episode, the summary, the exit code."""

import contextlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic_core import to_json
from rabbit_common import exit_codes
from rabbit_common.executables import LaunchError
from rabbit_common.exit_codes import ExitCode, Interrupted
from rabbit_common.own_folder import own_folder
from rabbit_description.task import ControlTask
from rabbit_description.task_source import load_task
from rabbit_recording import RecordingError
from rabbit_recording.task_recording import recorded_ride
from rabbit_viewer.ride_pictures import draw_ride

from rabbit_bringup.launching.walk import WalkSettings

Ended = Callable[[Any], None]  # gets the `Episode` message of an episode that has ended
UNTIMED = {"tick_ms_p50", "tick_ms_p99", "plant_ms_p50", "walk_seconds"}  # figures that no recording has


def carry_out(walk: WalkSettings, run: Callable[[Ended], Any]) -> int:
    """Walk as `run` does, which returns the monitor; say how it went; leave the summary. Returns the exit code."""
    outcomes: list[str] = []
    refused: list[str] = []  # controllers beside the walk's

    def tell(episode: Any) -> None:
        outcomes.append(episode.outcome)
        refused.extend(filter(None, [episode.refused_controller]))
        print(line(episode), flush=True)

    try:
        seconds = run(tell).seconds
    except Interrupted as error:
        complain(f"stopped by {error}; what was recorded is in {walk.folder}")
        return error.code
    except LaunchError as error:
        complain(f"{error}{_rescued(walk, error)}")
        return error.code
    code = exit_codes.of_walk(outcomes)
    if walk.options.record:
        try:
            _leave(walk, code, seconds)
        except RecordingError as error:
            complain(error)
    counted = exit_codes.counted(outcomes)
    print(f"written to {walk.folder}")
    others = f"; torques of {refused[0]} were refused" if refused else ""
    walked = counted.count("walked") + counted.count("done")
    print(f"{code.word}: {walked} of {len(counted)} episodes walked{others}", flush=True)
    return code


def line(episode: Any) -> str:
    """How an episode ended."""
    reason = f" ({episode.reason})" if episode.reason else ""
    stones = f"{episode.touchdowns - (episode.outcome == 'miss')} of {episode.stones} stones, " * bool(episode.stones)
    refused, controller = episode.refused_controller, episode.controller or "a controller without a name"
    two = f"; two controllers answered: {controller} walked, torques of {refused} were refused" if refused else ""
    ended = f"{episode.outcome}{reason}, {stones}{episode.tick} ticks{two}"
    return f"episode {episode.episode}, seed {episode.seed}: {ended}"


def complain(text: object) -> None:
    """One line on stderr."""
    print("rabbit:", " ".join(str(text).split()), file=sys.stderr, flush=True)


def _leave(walk: WalkSettings, code: ExitCode, seconds: float) -> None:
    """Summary, pictures and film from the recording; raises `RecordingError`."""
    recording = walk.folder / "recording"
    task = _task_of(walk)
    summary = write_summary(walk, task, recording, code, seconds)
    print(f"{summary['ticks']} ticks in {seconds:.1f} s: {summary['real_time_factor'] or 0:.1f} times real time")
    if timing := summary["real_time"]:
        print(
            f"real time: {timing['late_share']:.2%} of the ticks more than 2 ms late, {timing['missed']} unanswered in "
            f"time; age of the torque {timing['age_ms']['p99']:.1f} ms (p99)"
        )
    if not summary["ticks"]:
        return
    if task:
        if walk.options.pictures:
            ride = recorded_ride(task, recording)
            for path in draw_ride(ride, own_folder(walk.folder / "pictures", "walk"), video=walk.options.video):
                print(path)
        return
    from rabbit_viewer.walk_pictures import draw_pictures, film_walk
    from rich.console import Console

    with Console().status("drawing"):
        if walk.options.pictures:
            draw_pictures(walk.folder)
        if walk.options.video:
            film_walk(walk.folder)


def _rescued(walk: WalkSettings, error: LaunchError) -> str:
    """Summarise what a graph recorded that did not come to an end; what there is to say of it."""
    recording = walk.folder / "recording"
    if not recording.exists():
        with contextlib.suppress(OSError):  # nothing was left in it
            walk.folder.rmdir()
        return ""
    from rabbit_recording.open_recording import is_unfinished, storage_files
    from rabbit_recording.recover import recover

    note = f"; what was recorded until then: {recording}"
    with contextlib.suppress(RecordingError):
        if any(map(is_unfinished, storage_files(recording))):
            note = f"; unfinished: {recording}; `rabbit bag recover {recording}` makes a whole one of it"
            recording = recover(recording).path
            note += f", as {recording}"
        write_summary(walk, _task_of(walk), recording, error.code, None, str(error))
    return note


def _task_of(walk: WalkSettings) -> ControlTask | None:
    return load_task(walk.options.task) if walk.options.task else None


def write_summary(
    walk: WalkSettings,
    task: ControlTask | None,
    recording: Path,
    code: ExitCode,
    seconds: float | None,
    failure: str = "",
) -> dict[str, Any]:
    """Write `summary.json`, a row an episode; of RABBIT as in `rabbit evaluate`, with `records.npz` of the last one.

    `seconds`: by the wall clock, that the episodes took, where that is known; `failure`: why the graph did not come to
    an end, if it did not. Raises `RecordingError`.
    """
    from rabbit_description.atomic_file import replace_text
    from rabbit_experiments import provenance
    from rabbit_experiments.walk_records import DRAWN, WalkRecords, about_walk, save_records
    from rabbit_recording.reader import iterate_episodes
    from rabbit_recording.timing import real_time_figures

    rows, ticks, simulated, last = [], 0, 0.0, None
    for episode in iterate_episodes(recording, task):
        rows.append((_figures_of_ride(task, episode) if task else _figures_of_walk(walk, episode)) | _about(episode))
        ticks += len(episode.records)
        simulated += len(episode.records) * episode.tick_seconds
        last = episode if episode.records else last
    summary = {
        "walked": code is ExitCode.WALKED,
        "exit_code": int(code),
        "failure": failure,
        "episodes": rows,
        "ticks": ticks,
        "wall_seconds": seconds,
        "real_time_factor": simulated / seconds if seconds else None,
        "real_time": real_time_figures(recording),
        "command": provenance.command(),
        "commit": provenance.commit(),
        "versions": provenance.versions(),
        "controller": walk.options.controller if walk.options.is_foreign else walk.policy if task else walk.controller,
        **({"task": task.name} if task else {"simulation": walk.simulation}),
    }
    replace_text(walk.folder / "summary.json", to_json(summary, indent=2, inf_nan_mode="null").decode() + "\n")
    if last is not None and not task:
        version = last.records[-1].output.policy_version
        about = about_walk(walk.controller, walk.simulation, version, last.seed, last.outcome)
        if walk.options.is_foreign:
            name = last.controller or "a controller without a name"
            title = f"{name}, mass scale {walk.simulation.mass_scale:g}, seed {last.seed}: {last.outcome}"
            about = {key: value for key, value in about.items() if key not in DRAWN}
            about |= {"controller": name, "title": title}
        save_records(WalkRecords.from_ticks(last.records, last.landings, about), walk.folder / "records.npz")
    return summary


def _figures_of_ride(task: ControlTask, episode: Any) -> dict[str, Any]:
    """A `RecordedEpisode` of a task, without what `_about` says."""
    from rabbit_description.task_state import p_of, x_of

    states = [record.state for record in episode.records] + [episode.end] * (episode.end is not None)
    barriers = [task.tick.look(x_of(task, state), p_of(state)).barriers.tolist() for state in states]
    least = {barrier.name: min(values, default=None) for barrier, *values in zip(task.barriers, *barriers, strict=True)}
    figures = {"run": episode.number, "seed": episode.seed, "outcome": episode.outcome}
    return figures | {"ticks": len(episode.records), "least_barriers": least}


def _figures_of_walk(walk: WalkSettings, episode: Any) -> dict[str, Any]:
    """A `RecordedEpisode` of RABBIT, without what `_about` says."""
    from rabbit_experiments.metrics import RunTally
    from rabbit_sim.simulation import Outcome

    tally = RunTally(episode.number, walk.controller)
    for record in episode.records:
        tally.observe(record.output, record.state.foot_force)
    try:
        outcome = Outcome(episode.outcome)
    except ValueError:  # it did not end by the simulator
        outcome = Outcome.IDLE
        tally.fault = tally.fault or f"{episode.outcome}: {episode.reason}"
    return tally.result(episode.seed, outcome, episode.landings, [0.0], []).row.model_dump(exclude=UNTIMED)


def _about(episode: Any) -> dict[str, Any]:
    """What a recording holds of an episode beside its figures."""
    return {
        "reason": episode.reason,
        "ticks_not_recorded": episode.lost,
        "controller": episode.controller,
        "refused_controller": episode.refused_controller,
        "policies": list(dict.fromkeys(record.output.policy_version for record in episode.records)),
    }
