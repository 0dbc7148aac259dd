"""The numbers of seeded walks move on purpose only.

reference_walks.json has the figures of five short walks. When they move on purpose, write it again:

    python studies/test/test_reference_walks.py
"""

import json
from pathlib import Path
from typing import Any

import pytest
from rabbit_benchmark.methods import method
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import walk
from rabbit_reproduce.controllers import CBF_CLF, L1_CLF, RL_CBF_CLF

BEST = method("best").stones
assert BEST
REFERENCE = Path(__file__).with_name("reference_walks.json")
SEED = 7301
WALKS = {
    "nominal, twice the mass": CBF_CLF.assembly(mass_scale=2.0, stones=3),
    "learned, twice the mass": RL_CBF_CLF.assembly(mass_scale=2.0, stones=2),
    "identified, twice the mass": RL_CBF_CLF.with_policy("zero").assembly(
        {"adaptation": "identification", "objective": "pd_centred"}, mass_scale=2.0, stones=2
    ),
    "best, late torques": BEST.assembly(payload=40.0, torque_delay=0.006, stones=3),
    "L1, flat ground, rigid plant": L1_CLF.assembly(mass_scale=1.5, stones=2, plant="rigid"),
}
FIGURES = {"outcome", "stones", "ticks", "worst_margin", "max_force_ratio", "min_normal_force", "rms_y", "max_torque"}
FIGURES |= {"saturated_ticks", "slack_ticks", "rescue_ticks", "qp_unanswered_ticks"}
ADVICE = (
    "The numbers of seeded walks moved. If that was not meant, find out why. If it was, run "
    f"`python {Path(__file__).name}`."
)


def figures(assembly: Assembly) -> dict[str, Any]:
    """Of the reference run; JSON has no NaN."""
    row = walk(assembly, 0, SEED).row.model_dump(include=FIGURES)
    return {name: None if value != value else value for name, value in row.items()}


@pytest.mark.parametrize("name", WALKS)
def test_the_numbers_are_those_of_the_file(name: str) -> None:
    held = json.loads(REFERENCE.read_text())[name]
    for figure, value in figures(WALKS[name]).items():
        expected = pytest.approx(held[figure], rel=1e-6) if isinstance(value, float) else held[figure]
        assert value == expected, f"{name}: {figure} = {value}, was {held[figure]}. {ADVICE}"


def write() -> None:
    """Write the file again."""
    content = {name: figures(each) for name, each in WALKS.items()}
    REFERENCE.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write()
