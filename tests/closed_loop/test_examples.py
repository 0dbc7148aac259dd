"""The examples run as they stand and show what they claim; each walk of the lesson ends as its answer says."""

import importlib.util
import json
import re
import shlex
import sys
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import numpy as np
import pytest
from rabbit_common.options import Given
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.commands.play import DEFAULTS, PlayOptions
from rabbit_viewer.play.settings import NOBODY, Start, plant_of, settings_of
from rabbit_viewer.play.walker import Walker
from rl_cbf_clf_controller.parameters import ControllerParameters

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name):
    """Import an example by its file name."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def test_cruise_control_follows_the_closed_form_while_the_clf_alone_is_active():
    cruise = load("cruise_control")
    v, alpha = 10.0, 1 / 0.5 - 1  # half the mass
    beta, rate, p, y = alpha * cruise.DRAG * v, 2 / 0.5, 10.0, v - cruise.V_DESIRED
    error = cruise.ERROR(np.array([v]), np.array([cruise.MASS]), np.array([cruise.MASS / 2]))
    assert error.output_error.ravel() == pytest.approx([alpha, beta])
    assert -error.alpha[1] == pytest.approx([alpha])
    decided = cruise.TICK([v], error.alpha, error.beta, mass=cruise.MASS)
    hard = (-rate / 2 * y - beta) / (1 + alpha)  # divided by its size, with slack weight p:
    assert decided.active == ("CLF",)
    assert decided.mu[0] == pytest.approx(hard / (1 + 1 / p), rel=1e-5)


def test_cruise_control_keeps_the_limit_with_a_perfect_estimate_and_a_lighter_car_breaks_it_without():
    cruise = load("cruise_control")
    for scale in (0.5, 2.0):
        speeds = cruise.drive(scale, perfect=True)
        assert max(speeds) <= cruise.V_LIMIT + 1e-6
        assert speeds[-1] == pytest.approx(cruise.V_LIMIT, abs=0.01)
    assert max(cruise.drive(0.5, perfect=False)) > cruise.V_LIMIT + 0.05


def test_ppo_learns_in_gymnasium_and_writes_its_curve(tmp_path, monkeypatch):
    pytest.importorskip("rabbit_rivals", reason="the studies are not installed")
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    monkeypatch.setattr(sys, "argv", ["train_ppo.py", str(tmp_path), "1024"])
    load("train_ppo")
    read = events.EventAccumulator(str(tmp_path / "PPO_1"))
    read.Reload()
    (curve,) = read.Scalars("rollout/ep_rew_mean")
    assert curve.step == 1024
    assert curve.value < 0  # minus squared errors
    assert (tmp_path / "ppo.zip").exists()


def test_notebook_goes_from_a_policy_to_the_figures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["notebook.py", "--runs", "3", "--stones", "4", "--out", str(tmp_path)])
    notebook = load("notebook")
    assert len(re.findall(r"^# %% \d+", (EXAMPLES / "notebook.py").read_text(), re.MULTILINE)) == 10
    assert all(row.success for row in notebook.rows["learned"])
    assert [row.seed for row in notebook.rows["learned"]] == [row.seed for row in notebook.rows["nominal"]]
    assert notebook.only == [sum(not row.success for row in notebook.rows["nominal"]), 0]
    assert notebook.errors[0] < 0.5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["estimates.pdf", "walk.pdf", "walk.png"]


def test_the_worked_tick_has_the_numbers_of_its_page(capsys):
    load("worked_tick")
    page = (EXAMPLES.parent / "docs" / "worked_tick.md").read_text()
    shown, printed = page.split("```text\n")[1].split("```")[0], capsys.readouterr().out
    number = re.compile(r"(?<=\s)-?\d+(?:\.\d+)?(?=\s)")
    assert number.sub("", shown).split() == number.sub("", printed).split()
    numbers = [[float(digits) for digits in number.findall(text)] for text in (shown, printed)]
    assert numbers[1] == pytest.approx(numbers[0], rel=0.02)
    B1, dB1 = (float(group) for group in re.search(r"^B1 \(m\), B1' +(\S+) +(\S+)", printed, re.MULTILINE).groups())
    required = float(re.search(r"^-K_b .* (\S+)$", printed, re.MULTILINE)[1])
    assert required == pytest.approx(-4900 * B1 - 140 * dB1, rel=0.02)
    assert float(re.search(r"^B1'' estimated +(\S+)", printed, re.MULTILINE)[1]) == pytest.approx(required, rel=0.01)


LESSON = (EXAMPLES.parent / "docs" / "lesson.md").read_text(encoding="utf-8")
OPENED = r"\[[^]]+\]\((?P<link>[^)]+)\)|`rabbit play (?P<options>[^`]+)`"
ROWS = list(re.finditer(rf"^\| (?:{OPENED}) \|(?P<ends>.+)\|$", LESSON, re.MULTILINE))


def asked(row: re.Match[str]) -> dict[str, Any]:
    """The settings of a link, or the options of a command, by name."""
    if row["link"]:
        return dict(parse_qsl(urlsplit(row["link"]).fragment))
    words = shlex.split(row["options"])
    names = [word.removeprefix("--").replace("-", "_") for word in words[::2]]
    return dict(zip(names, words[1::2], strict=True))


def start(asked: dict[str, Any]) -> Start:
    """What the page begins with."""
    models = PlayOptions, SimulationParameters, ControllerParameters
    assert asked.keys() <= set().union(*(model.model_fields for model in models))
    given = Given(asked, DEFAULTS)
    plant, robots = given.build(SimulationParameters), given.build(PlayOptions)
    settings = settings_of(plant, first=robots.first, second=robots.second, seed=robots.seed)
    return Start(settings=settings, plant=plant, controller=given.build(ControllerParameters))


def walked(name: str, begun: Start) -> str:
    """How the robot of this name does, in the lesson's words."""
    walker = Walker(name, begun, plant_of(begun.plant, begun.settings), begun.settings.seed)
    try:
        while not walker.outcome:
            walker.tick()
        ended = walker.ended
    finally:
        walker.close()
    return "walks" if ended["outcome"] == "walked" else f"falls after {ended['stones']}"


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["options"] or row["link"].partition("#")[2])
def test_a_walk_ends_as_the_answer_says(row: re.Match[str]) -> None:
    begun = start(asked(row))
    robots = [name for name in (begun.settings.first, begun.settings.second) if name != NOBODY]
    assert [walked(name, begun) for name in robots] == [end.strip() for end in row["ends"].split("|")]


@pytest.mark.thorough
def test_the_notebook_runs_from_above_to_below(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "Agg")
    space: dict[str, Any] = {}
    cells = json.loads((EXAMPLES / "lesson.ipynb").read_text(encoding="utf-8"))["cells"]
    for source in ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]:
        exec(source.replace("RUNS = 3", "RUNS = 1"), space)  # as Jupyter does
    assert {"mass", "gain", "width", "friction", "push", "noise", "delay", "learning"} <= space["shares"].keys()
    assert all(0 <= share <= 1 for curves in space["shares"].values() for curve in curves.values() for share in curve)
    assert space["shares"]["mass"]["best"][2] == 1  # twice the mass
