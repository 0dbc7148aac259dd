"""Tutorials, and other pages with whole programs: every block is run as a reader types it, on shorter walks."""

import re
import subprocess
from pathlib import Path

import pytest
from rl_cbf_clf_controller.weights import policy_path, read
from typed import ROOT, blocks, type_in

WALK = "--stones 3 --no-video --no-pictures"
ALONE = "--no-trainer --no-record"
COURSES = "--runs 1 --stones 2"
RIDES = "--rides 1"
ELSEWHERE = {"ros2_ws/src/cbf_clf_qp/README.md", "docs/operations.md"}  # in tests of their own
SHORTER = {
    "studies/docs/benchmark.md": {"rabbit benchmark": "--cells flat/scale-1 --courses 1"},
    "docs/evaluate.md": {"rabbit evaluate": COURSES},
    "ros2_ws/src/rl_cbf_clf_controller/README.md": {},
    "docs/get_started.md": {
        "rabbit walk --controller cbf-clf-qp": f"{ALONE} --stones 6",
        "rabbit walk": f"{ALONE} --stones 3 --episodes 2",
        "rabbit evaluate": COURSES,
        "rabbit train": "--episodes 1",
        "rabbit policy load": "--timeout 120",
    },
    "ros2_ws/src/rabbit_experiments/README.md": {},
    "docs/own_system.md": {"rabbit train": "--episodes 1", "rabbit evaluate": RIDES, "rabbit benchmark": RIDES},
    "docs/tutorials/notebook.md": {"python examples/notebook.py": COURSES, "rabbit walk": WALK},
    "docs/tutorials/own_barrier.md": {"rabbit walk": WALK},
    "docs/tutorials/own_learner.md": {"python": "--episodes 5 --steps 4"},
    "docs/tutorials/own_node.md": {"rabbit walk": WALK},
    "docs/tutorials/own_robot.md": {},
    "docs/tutorials/ros_graph.md": {
        "rabbit walk": "--stones 15 --no-video --no-pictures",
        "rabbit policy load": "--timeout 120",
    },
}


def said_by(page: str, folder: Path) -> str:
    """What a page prints, made shorter."""
    return type_in(page, folder, SHORTER[page])


def test_every_page_with_blocks_is_run() -> None:
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert {name for name in listed.stdout.split() if blocks(ROOT / name)} == SHORTER.keys() | ELSEWHERE


WITHOUT_A_TEST_OF_ITS_OWN = (
    *("studies/docs/benchmark.md", "docs/evaluate.md", "docs/own_system.md", "docs/tutorials/notebook.md"),
    *(f"ros2_ws/src/{package}/README.md" for package in ("rl_cbf_clf_controller", "rabbit_experiments")),
)


@pytest.mark.timeout(900)  # a page has ten commands, and each starts its own process
@pytest.mark.parametrize("page", WITHOUT_A_TEST_OF_ITS_OWN)
def test_a_page_does_what_it_says(page: str, tmp_path: Path) -> None:
    said_by(page, tmp_path)


def test_get_started(tmp_path: Path) -> None:
    said = said_by("docs/get_started.md", tmp_path)
    assert re.search(r"^episode 1, seed 1: (?!walked)", said, re.MULTILINE)  # the first walk that it types
    assert "policy.safetensors: loaded" in said


@pytest.mark.timeout(1500)
def test_own_barrier(tmp_path: Path) -> None:
    """At twice the mass the nominal robot falls; with learned estimates it walks and never leans over the limit."""
    said = said_by("docs/tutorials/own_barrier.md", tmp_path)
    assert "walked: 1 of 1 episodes walked" in said
    leans = re.findall(r"^(\S+), seed \d+: (\d+) steps, lean up to (\S+) rad", said, re.MULTILINE)
    steps, learned = 20, [lean for lean in leans if lean[0] != "zero"]
    assert max(int(row[1]) for row in leans if row[0] == "zero") < steps
    assert {int(row[1]) for row in learned} == {steps}
    assert all(float(row[2]) < 0.345 + 2e-4 for row in learned)


def test_own_robot(tmp_path: Path) -> None:
    said = said_by("docs/tutorials/own_robot.md", tmp_path)
    assert re.search(r"nominal rows: .* HITS", said)
    assert re.search(r"true rows: .* stays below", said)
    walked = re.findall(r"(nominal|oracle) .* (\d) of 2 .* (\d+\.\d) \(", said)
    assert [(name, kept) for name, kept, _ in walked] == [("nominal", "0"), ("oracle", "2")]
    assert float(walked[0][2]) < 5
    assert float(walked[1][2]) == 100


def test_own_learners_error_falls(tmp_path: Path) -> None:
    said = said_by("docs/tutorials/own_learner.md", tmp_path)
    losses = [float(number) for number in re.findall(r"mean error (\S+)", said)]
    assert len(losses) >= 2
    assert losses[-1] < losses[0]


def test_own_nodes(tmp_path: Path) -> None:
    said = said_by("docs/tutorials/own_node.md", tmp_path)
    assert "3 of 3 stones" in said
    assert " 0 lost" in said
    assert (tmp_path / "runs" / "stand.mp4").is_file()


def test_ros_graph(tmp_path: Path) -> None:
    said = said_by("docs/tutorials/ros_graph.md", tmp_path)
    assert "torques identical" in said
    assert read(policy_path("rl-clf-qp")).version in said
    assert list(tmp_path.rglob("*.png"))
