"""The figures of a run on hand-made ticks; intervals with known ends; a results folder; measured scales."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_description.force_ratio import impact_ticks
from rabbit_description.gait import load_gait
from rabbit_description.state import Array, Leg, RobotState, StonePreview
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.cache import Cache
from rabbit_experiments.commands.scales import app
from rabbit_experiments.measured_scales import measure_scales
from rabbit_experiments.metrics import RunResult, RunRow, RunTally
from rabbit_experiments.summary import mean_interval, summarise, wilson
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Landing, Outcome
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.problem import LEAST, ROOM
from rl_trainer.rollout import Record
from typer.testing import CliRunner

PARAMETERS = load_parameters("ours")
LATE = impact_ticks()  # a tick's age at which the impact is over


@pytest.fixture(scope="module")
def record() -> Record:
    """One real tick to be altered."""
    gait = load_gait(PARAMETERS.gait)
    q, dq = gait.x_start
    contact = np.array([True, False])
    state = RobotState(0, q, dq, np.zeros((2, 2)), contact, 0, StonePreview(1, 0.35, 0.4))
    output = Controller(PARAMETERS, gait, ZeroPolicy(PARAMETERS.problem)).step(state)
    return Record(state, output)


def row_of(record: Record, forces: list[tuple[float, float]], age: int = LATE) -> RunRow:
    """A run whose stance foot has these forces from `age` ticks after the start on, and pushes before."""
    every = [(0.0, 300.0)] * (age or 1) + forces
    tally = RunTally(0, PARAMETERS)
    for tick, force in enumerate(every):
        tally.observe(replace(record.output, tick=tick, step_index=0 if age else tick), np.array([force, force]))
    return tally.result(7, Outcome.WALKED, [], [0.001], []).row


@pytest.mark.parametrize(
    ("force", "over", "lost"),
    [
        ((79.0, 100.0), 0, 0),
        ((81.0, 100.0), 1, 0),
        ((-81.0, 100.0), 1, 0),
        ((19.0, 20.0), 0, 0),  # not loaded: no ratio
        ((0.0, 0.0), 0, 1),
        ((0.0, -5.0), 0, 1),
    ],
)
def test_violations(record: Record, force: tuple[float, float], over: int, lost: int) -> None:
    late, early = row_of(record, [force]), row_of(record, [force], age=LATE - 1)
    assert (late.ticks_over_cone, late.ticks_lost) == (over, lost)
    assert (early.ticks_over_cone_at_impact, early.ticks_lost_at_impact) == (over, lost)
    assert early.ticks_over_cone == early.ticks_lost == 0


def run(record: Record, landings: list[Landing], outcome: Outcome, force: Array, **changes: Any) -> RunResult:
    """A run of as many steps as landings, four late ticks each."""
    tally = RunTally(0, PARAMETERS)
    for tick in range(2 * LATE * max(len(landings), 1)):
        step = tick // (2 * LATE)
        output = replace(record.output, tick=tick, step_index=step, stance=Leg(step % 2), **changes)
        tally.observe(output, force)
    seconds = [0.001] * tally.ticks
    return tally.result(7, outcome, landings, seconds, seconds)


GOOD = Landing(1, 8, 0.37, 0.35, 0.40, on_stone=True)
SHORT = Landing(2, 16, 0.34, 0.35, 0.40, on_stone=True)
IN_GAP = Landing(2, 16, 0.34, 0.35, 0.40, on_stone=False)
STANDING = np.array([[10.0, 300.0], [10.0, 300.0]])


def test_a_walk_over_all_stones_is_a_success_with_the_rms_of_all_outputs(record: Record) -> None:
    eta = np.array([0.3, 0.4, 0, 0, 3, 4, 0, 0])
    row = run(record, [GOOD, replace(GOOD, index=2)], Outcome.WALKED, STANDING, eta=eta).row
    assert (row.success, row.success_with_forces, row.stones, row.missed_stones) == (True, True, 2, 0)
    assert row.worst_margin == pytest.approx(0.02)
    assert (row.outcome, row.steps, row.ticks) == ("walked", 2, 4 * LATE)
    assert (row.rms_y, row.rms_dy) == (pytest.approx(0.25), pytest.approx(2.5))


@pytest.mark.parametrize("missed", [SHORT, IN_GAP])
def test_a_missed_stone_is_none_even_if_the_walk_goes_on(record: Record, missed: Landing) -> None:
    row = run(record, [GOOD, missed, replace(GOOD, index=3)], Outcome.WALKED, STANDING).row
    assert (row.success, row.success_with_forces, row.stones, row.missed_stones) == (False, False, 1, 1)


def test_a_run_whose_first_state_is_refused_has_a_row() -> None:
    tally = RunTally(0, PARAMETERS)
    tally.fault = "controller error: state.q[0] = nan"
    result = tally.result(7, Outcome.IDLE, [], [], [])
    assert (result.row.outcome, result.row.ticks, result.row.stones) == ("controller error", 0, 0)
    assert not result.row.success
    assert summarise([result], "osqp")["tick_ms_p50"] is None


def test_forces_are_judged_apart_from_stones(record: Record) -> None:
    row = run(record, [GOOD], Outcome.WALKED, STANDING * [10, 1]).row
    assert (row.success, row.success_with_forces) == (True, True)  # 100 N of 300 N
    row = run(record, [GOOD], Outcome.WALKED, STANDING * [25, 1]).row
    assert (row.success, row.success_with_forces) == (True, False)
    assert (row.ticks_over_cone, row.ticks_over_cone_at_impact) == (LATE, LATE - 1)  # no force before tick 0


def test_barriers_that_begin_outside_their_promise_are_counted_once_a_step(record: Record) -> None:
    pole = PARAMETERS.barrier_pole_1
    sinking = {"barriers": np.array([1.0, 0.5]), "barrier_rates": np.array([0.0, -0.5 * pole - 1e-6])}
    assert run(record, [GOOD, GOOD], Outcome.WALKED, STANDING, **sinking).row.ecbf_start_violations == 2
    sound = {**sinking, "barrier_rates": np.array([0.0, -0.5 * pole + 1e-6])}
    assert run(record, [GOOD, GOOD], Outcome.WALKED, STANDING, **sound).row.ecbf_start_violations == 0


def result(run: int, **changes: Any) -> RunResult:
    """A run in which nothing happened, but for `changes`."""
    values: dict[str, Any] = dict.fromkeys(RunRow.model_fields, 0)
    values |= {"run": run, "outcome": "walked", "success": True, "success_with_forces": True, "stones": 20}
    values |= {"ticks": 4, "steps": 2, "walk_seconds": 0.01, "least_barriers": {}, **changes}
    return RunResult(row=RunRow.model_validate(values), violations=[], tick_seconds=[0.002] * 4)


@pytest.mark.parametrize(("successes", "runs"), [(0, 10), (5, 10), (49, 50), (50, 50)])
def test_wilson_interval_solves_its_equation(successes: int, runs: int) -> None:
    z = 1.959963984540054
    for end in wilson(successes, runs):
        share = successes / runs
        assert (share - end) ** 2 == pytest.approx(z**2 * end * (1 - end) / runs, abs=1e-12)


def test_interval_of_the_mean_of_two_values() -> None:
    low, high = mean_interval(np.array([1.0, 3.0])) or (math.nan, math.nan)
    half = math.tan(math.pi * 0.475)  # Student's t of one degree of freedom is Cauchy's; standard error 1
    assert [low, high] == pytest.approx([2 - half, 2 + half])
    assert mean_interval(np.array([4.0])) is None


@pytest.mark.parametrize("runs", [2, 3, 5, 20])
def test_the_mean_of_counts_lies_where_a_mean_of_them_can(runs: int) -> None:
    """Of 0 to 20 stones, most runs at the end: the interval is cut, and misses the true mean no more often."""
    rng, cut = np.random.default_rng(4), 0
    for _ in range(200):
        stones = np.where(rng.random(runs) < 0.6, 20, rng.integers(0, 21, runs)).astype(float)  # 16 in the mean
        low, high = mean_interval(stones, 0, 20) or (math.nan, math.nan)
        whole = mean_interval(stones) or (math.nan, math.nan)
        assert 0 <= low <= stones.mean() <= high <= 20
        assert (low <= 16 <= high) == (whole[0] <= 16 <= whole[1])
        cut += (low, high) != whole
    assert cut > 10


def test_summary_counts() -> None:
    runs = [
        result(0),
        result(1, success_with_forces=False, ticks_over_cone=3, max_force_ratio=0.9),
        result(2, success=False, success_with_forces=False, outcome="gap_fall", stones=5, missed_stones=1),
        result(3, success=False, success_with_forces=False, outcome="fall", stones=7, qp_unanswered_ticks=1),
    ]
    summary = summarise(runs, "osqp")
    assert (summary["success_rate"], summary["success_with_forces"]) == (0.5, 0.25)
    assert summary["falls"] == {"gap_fall": 1, "fall": 1}
    assert (summary["mean_stones"], summary["missed_stones"]) == (13.0, 1)
    assert (summary["ticks_over_cone"], summary["max_force_ratio"]) == (3, 0.9)
    assert summary["qp_solver_share"] == 15 / 16
    assert summary["tick_ms_p50"] == pytest.approx(2.0)
    assert summary["real_time_factor"] == pytest.approx(4.0)
    json.dumps(summary, allow_nan=False)
    of_ticks = summarise([result(0, rms_y=0.3, ticks=1), result(1, rms_y=0.1, ticks=9)], "osqp")
    assert of_ticks["rms_y"] == pytest.approx(math.sqrt(0.018))  # over all ticks, not over runs


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_what_is_to_be_estimated_of_a_robot_that_is_its_model_and_of_one_twice_as_heavy(
    scale: float, tmp_path: Path
) -> None:
    """Nothing; and alpha of V is -LgV / 2, in units of |LgV| + 1. A torque's share of the force knows no mass."""
    plant = SimulationParameters(plant="rigid", mass_scale=scale, stones=3, stop_at_miss=False)
    assembly = Assembly(plant, load_parameters("ours", controller="rl-cbf-clf-qp"), "oracle")
    found = measure_scales(assembly, (5,), Cache(tmp_path))
    if scale == 1:
        assert set(found["alpha_scale"]) == set(found["beta_scale"]) == {LEAST}
        return
    V, *_, C1, C2 = found["alpha_scale"]
    assert 0.5 * ROOM / 2 < V < 0.5 * ROOM  # of four components the greatest has at least half of the length
    assert C1 == C2 == LEAST
    assert all(value > 1 for value in found["error_scale"])


def test_the_line_in_a_file_is_written_and_nothing_else(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("A = 1\nSCALES: Any = {}\nB = 2\n")
    words = ["--controller", "rl-clf-qp", "--plant", "rigid", "--stones", "2", "--walks", "1", "--into", str(file)]
    words += ["--jobs", "1", "--out", str(tmp_path / "walks")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    first, line, last = file.read_text().splitlines()
    assert (first, last) == ("A = 1", "B = 2")
    assert line.replace("SCALES: Any", "SCALES") == done.output.strip().splitlines()[-1]
