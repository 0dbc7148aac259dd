"""What a walk leaves behind, made from its recording: records, summary, pictures, film."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_cli.exit_codes import ExitCode
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments import provenance
from rabbit_experiments.metrics import RunTally
from rabbit_recording.reader import RecordedEpisode, iterate_episodes
from rabbit_recording.timing import real_time_figures
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Outcome
from rabbit_viewer.walk_records import WalkRecords, about_walk, save_records
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.rollout import Record

from rabbit_bringup.launching.walk import Walk

OUTCOMES = {outcome.value: outcome for outcome in Outcome}
UNTIMED = ("tick_ms_p50", "tick_ms_p99", "plant_ms_p50", "walk_seconds")


def write_summary(
    walk: Walk, recording: Path, code: ExitCode, wall_seconds: float | None, failure: str = ""
) -> dict[str, Any]:
    """Write `summary.json`, a row an episode as in `rabbit evaluate`, and `records.npz` of the last one with ticks.

    Args:
        walk: what was to be walked, in which folder.
        recording: of the walk.
        code: how it ended.
        wall_seconds: that its episodes took, where that is known.
        failure: why the graph did not come to its end, if it did not.

    Raises:
        RecordingError: the recording cannot be read.
    """
    folder, simulation, controller = walk.folder, walk.simulation, walk.controller
    rows: list[dict[str, Any]] = []
    ticks, last = 0, None
    for episode in iterate_episodes(recording):
        rows.append(describe(episode, controller))
        ticks += len(episode.records)
        last = episode if episode.records else last
    summary = {
        "walked": code is ExitCode.WALKED,
        "exit_code": int(code),
        "failure": failure,
        "episodes": rows,
        "ticks": ticks,
        "wall_seconds": wall_seconds,
        "real_time_factor": ticks * TICK_SECONDS / wall_seconds if wall_seconds else None,
        "real_time": real_time_figures(recording),
        "command": provenance.command(),
        "commit": provenance.commit(),
        "versions": provenance.versions(),
        "controller": controller.model_dump(mode="json"),
        "simulation": simulation.model_dump(mode="json"),
    }
    (folder / "summary.json").write_text(json.dumps(_plain(summary), indent=2) + "\n", encoding="utf-8")
    if last is not None:
        save_records(records_of(last, simulation, controller), folder / "records.npz")
    return summary


def describe(episode: RecordedEpisode, controller: ControllerParameters) -> dict[str, Any]:
    """An episode in figures."""
    here: dict[str, Record] = {}
    tally = RunTally(episode.number, controller, lambda: here["tick"].state.foot_force)
    for record in episode.records:
        here["tick"] = record
        tally(record)
    outcome = OUTCOMES.get(episode.outcome)
    if outcome is None:
        tally.fault = tally.fault or f"{episode.outcome}: {episode.reason}"
    row = tally.result(episode.seed, outcome or Outcome.IDLE, episode.landings, [0.0], []).row
    versions = list(dict.fromkeys(record.output.policy_version for record in episode.records))
    return {
        **row.model_dump(exclude=set(UNTIMED)),
        "reason": episode.reason,
        "ticks_not_recorded": episode.lost,
        "policies": versions,
    }


def records_of(
    episode: RecordedEpisode, simulation: SimulationParameters, controller: ControllerParameters
) -> WalkRecords:
    """What the pictures are drawn from."""
    policy = episode.records[-1].output.policy_version
    about = about_walk(controller, simulation, policy, episode.seed, episode.outcome)
    return WalkRecords.from_ticks(episode.records, episode.landings, about)


def _plain(value: Any) -> Any:
    """JSON has no NaN."""
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
