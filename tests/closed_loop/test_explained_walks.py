"""The cases that pages explain walked again, and what is said of ticks with slack against another solver."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import daqp
import numpy as np
import pytest
from cbf_clf_qp.functions import Values
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_experiments.walk_records import RESCUE_NEEDED
from rabbit_recording.explaining import WORDS
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.explanation import Explanation, explain
from rl_cbf_clf_controller.parameters import load_parameters
from rl_trainer.rollout import Record, rollout
from scipy.optimize import nnls

ROOT = Path(__file__).resolve().parents[2]
EXPLAINED = "docs/explain.md", "qa/docs/data/measurements.md"
PAGES = "".join((ROOT / each).read_text(encoding="utf-8") for each in EXPLAINED)
CASES = {  # of these pages: controller, plant, seed, tick
    "double": ("cbf-clf-qp", {"mass_scale": 2.0}, 1, 78),
    "push": ("clf-qp", {"terrain": "flat", "push": 30.0}, 42, 172),
    "narrow": ("rl-cbf-clf-qp", {"mass_scale": 2.0, "stone_width": 0.02}, 5, 38),
}
FAR = 1e29  # a bound that is none


def explained(
    controller: str, plant: dict[str, object], seed: int, solver: str, wanted: Callable[[Record], bool]
) -> Iterator[tuple[Explanation, Values, Controller]]:
    """The wanted ticks of a walk: what is said of them, the QP's data, the controller."""
    parameters = load_parameters("ours", controller=controller).model_copy(update={"qp_solver": solver})
    policy = resolve_policy("rl-cbf-clf-qp", parameters) if controller == "rl-cbf-clf-qp" else "zero"
    lagging = SimulationParameters.model_validate({"motor_lag": EVALUATION_LAG, **plant})  # as `rabbit walk` has it
    simulation, walker = Assembly(lagging, parameters, policy).build()
    found: list[tuple[Explanation, Values, Controller]] = []

    def take(record: Record) -> None:
        if wanted(record):
            at = walker.scene.x, walker.scene.p, walker.estimates
            found.append((explain(walker.qp, *at, walker.decided), walker.qp.programme(*at), walker))

    rollout(simulation, walker, seed, take)
    simulation.close()
    yield from found


@pytest.mark.parametrize("case", CASES)
def test_the_page_shows_what_is_said(case: str) -> None:
    controller, plant, seed, tick = CASES[case]
    ((told, *_),) = explained(controller, plant, seed, "osqp", lambda record: record.state.tick == tick)
    shown = re.findall(rf"explain {case}/recording.*?```text\n(.*?)```", PAGES, re.DOTALL)[0]
    lines = told.lines(WORDS)
    assert shown.splitlines()[3 : 3 + len(lines)] == lines


def half_planes(data: Values, chosen: list[int], inputs: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """A v <= b of rows without their slacks, of norm 1, v = mu / scale as the QP's solver has it."""
    A = data.A[chosen, :inputs]
    norm = np.linalg.norm(A, axis=1)
    both = np.vstack([A, -A]) / np.tile(norm, 2)[:, None]
    bounds = np.concatenate([data.upper[chosen], -data.lower[chosen]]) / np.tile(norm, 2) / scale
    return both[bounds < FAR / scale / norm.max()], bounds[bounds < FAR / scale / norm.max()]


def least_beyond(A: np.ndarray, b: np.ndarray) -> float:
    """By how much the least v with A v <= b misses it, by DAQP; large where there is none."""
    m = A.shape[1]
    v = daqp.solve(np.eye(m), np.zeros(m), A, b, np.full(len(b), -1e30), np.zeros(len(b), dtype=np.int32))[0]
    return float((A @ v - b).max())


def test_the_sets_of_falling_robots_exclude_themselves_and_no_subset_does() -> None:
    """Certificates by non-negative least squares (Farkas); feasible points and multipliers by DAQP."""
    sets = 0
    for solver, seed in (("daqp", 5), ("osqp", 6), ("daqp", 71), ("osqp", 72)):
        plant: dict[str, object] = {"mass_scale": 2.0, "stone_width": 0.02}
        slack = explained("rl-cbf-clf-qp", plant, seed, solver, lambda r: r.output.rescue_slack > RESCUE_NEEDED)
        for told, data, walker in slack:
            names, scale = [row.name for row in told.rows], 1 + float(np.linalg.norm(walker.decided.mu))
            chosen = [names.index(name) for name in told.excluding]
            every = [i for i, row in enumerate(told.rows) if row.kind != "soft"]
            if not chosen:
                assert least_beyond(*half_planes(data, every, 4, scale)) < 1e-6
                continue
            sets += 1
            A, b = half_planes(data, chosen, 4, scale)
            assert nnls(np.vstack([A.T, b]), np.array([0, 0, 0, 0, -1.0]))[1] < 1e-9
            for i in chosen:
                rest = [j for j in chosen if j != i]
                assert least_beyond(*half_planes(data, rest, 4, scale)) < 1e-6
            n = data.A.shape[1]
            answer = daqp.solve(
                2 * np.eye(n), data.q, data.A, data.upper, data.lower, np.zeros(len(names), dtype=np.int32)
            )
            multipliers = answer[3]["lam"] / data.row_scale
            np.testing.assert_allclose([row.multiplier for row in told.rows], multipliers, rtol=1e-4, atol=1e-4)
    assert sets >= 20
