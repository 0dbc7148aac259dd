"""The same run by the commands: through nodes, recorded and replayed; by one process, by two, and resumed."""

import csv
from pathlib import Path

import pytest
from drawn_runs import Run, Tick, assert_same, runs, tick_of, walk
from hypothesis import Phase, assume, given, settings
from rabbit_bringup.cli import app
from rabbit_bringup.launching.walk import WalkOptions, WalkSettings
from rabbit_bringup.ros.walk_monitor import walk_through
from rabbit_experiments.assembly import resolve_policy
from rabbit_recording.checking import check_episodes
from recorded_walk import read_episodes
from typer.testing import CliRunner

EXAMPLES = max(settings.default.max_examples // 50, 1)
DRAWN = settings(max_examples=EXAMPLES, phases=(Phase.reuse, Phase.generate))
TIMES = {"tick_ms_p50", "tick_ms_p99", "plant_ms_p50", "walk_seconds"}
TO_THE_END = 10_000  # ticks


def whole(run: Run) -> Run:
    """Until the robot has walked, or falls."""
    return run.model_copy(update={"ticks": TO_THE_END})


@pytest.mark.timeout(600)
@DRAWN
@given(run=runs())
def test_the_walk_through_nodes_and_its_replay(tmp_path_factory: pytest.TempPathFactory, run: Run) -> None:
    """But for the oracle, which no node has. A refused tick is in no recording."""
    assume(run.policy != "oracle")
    folder, run = tmp_path_factory.mktemp("walk"), whole(run)
    options, policy = WalkOptions(seed=run.seed, trainer=False), resolve_policy(run.policy, run.controller)
    parts = {"simulation": run.simulation, "controller": run.controller, "policy": policy}
    walk_through(WalkSettings(folder=folder, options=options, **parts))
    with run.parts() as parts:
        inside = [tick_of(found) for found in walk(run, parts) if not isinstance(found, str)]
    (episode,) = read_episodes(folder / "recording").values()
    assert_same([Tick.of(record) for record in episode.records], inside, run, "through nodes")
    (checked,) = check_episodes(folder / "recording")
    assert (checked.replayed, checked.differing) == (len(inside), []), f"replayed: {run!r}"


def evaluate(run: Run, out: Path, *words: object) -> list[dict[str, str]]:
    """`rabbit evaluate`: its table without times."""
    words = ("evaluate", "--out", out, "--policy", run.policy, "--seed", run.seed, *words)
    for part in (run.controller, run.simulation):
        for name, value in part.model_dump().items():
            option = name.replace("_", "-")
            if isinstance(value, bool):
                words += (f"--{option}" if value else f"--no-{option}",)
            elif value != "":
                words += (f"--{option}", value)
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, f"{done.output}: {run!r}"
    with (out / "runs.csv").open(encoding="utf-8") as file:
        return [{name: value for name, value in row.items() if name not in TIMES} for row in csv.DictReader(file)]


@pytest.mark.timeout(600)
@DRAWN
@given(run=runs())
def test_an_evaluation_by_one_process_by_two_and_resumed(tmp_path_factory: pytest.TempPathFactory, run: Run) -> None:
    one, two, resumed = (tmp_path_factory.mktemp(name) for name in ("one", "two", "resumed"))
    expected = evaluate(run, one, "--runs", 2, "--jobs", 1)
    assert len(expected) == 2
    assert evaluate(run, two, "--runs", 2, "--jobs", 2) == expected, f"--jobs 2: {run!r}"
    evaluate(run, resumed, "--runs", 1, "--jobs", 1)
    assert evaluate(run, resumed, "--runs", 2, "--jobs", 1) == expected, f"resumed: {run!r}"
