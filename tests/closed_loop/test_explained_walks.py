"""The cases that pages explain, walked again."""

import re
from pathlib import Path

import pytest
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_recording.explaining import WORDS
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.explanation import explain
from rl_cbf_clf_controller.parameters import load_parameters
from rl_trainer.rollout import Record, rollout

ROOT = Path(__file__).resolve().parents[2]
EXPLAINED = "docs/explain.md", "qa/docs/data/measurements.md"
PAGES = "".join((ROOT / each).read_text(encoding="utf-8") for each in EXPLAINED)
CASES = {  # of these pages: controller, plant, seed, tick
    "double": ("cbf-clf-qp", {"mass_scale": 2.0}, 1, 78),
    "push": ("clf-qp", {"terrain": "flat", "push": 30.0}, 42, 172),
    "narrow": ("rl-cbf-clf-qp", {"mass_scale": 2.0, "stone_width": 0.02}, 5, 38),
}


@pytest.mark.parametrize("case", CASES)
def test_the_page_shows_what_is_said(case: str) -> None:
    controller, plant, seed, tick = CASES[case]
    parameters = load_parameters("ours", controller=controller)
    policy = resolve_policy("rl-cbf-clf-qp", parameters) if controller == "rl-cbf-clf-qp" else "zero"
    lagging = SimulationParameters.model_validate({"motor_lag": EVALUATION_LAG, **plant})  # as `rabbit walk` has it
    simulation, walker = Assembly(lagging, parameters, policy).build()
    told: list[list[str]] = []

    def take(record: Record) -> None:
        if record.state.tick == tick:
            at = walker.scene.x, walker.scene.p, walker.estimates
            told.append(explain(walker.qp, *at, walker.decided).lines(WORDS))

    rollout(simulation, walker, seed, take)
    simulation.close()
    shown = re.findall(rf"explain {case}/recording.*?```text\n(.*?)```", PAGES, re.DOTALL)[0]
    assert told == [shown.splitlines()[3 : 3 + len(told[0])]]
