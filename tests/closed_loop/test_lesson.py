"""The lesson: each link and command opens the walk that its answer tells of."""

import json
import re
import shlex
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import pytest
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.commands.play import DEFAULTS
from rabbit_viewer.play.settings import NOBODY, Start, plant_of, settings_of
from rabbit_viewer.play.walker import Walker
from rl_cbf_clf_controller.parameters import ControllerParameters

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "examples" / "lesson.ipynb"
LESSON = (ROOT / "docs" / "lesson.md").read_text(encoding="utf-8")
OPENED = r"\[[^]]+\]\((?P<link>[^)]+)\)|`rabbit play (?P<options>[^`]+)`"
ROWS = list(re.finditer(rf"^\| (?:{OPENED}) \|(?P<ends>.+)\|$", LESSON, re.MULTILINE))


def asked(row: re.Match[str]) -> dict[str, Any]:
    """The settings of a link, or the options of a command, by name."""
    if row["link"]:
        return dict(parse_qsl(urlsplit(row["link"]).fragment))
    words = shlex.split(row["options"])
    names = [word.removeprefix("--").replace("-", "_") for word in words[::2]]
    return dict(zip(names, words[1::2], strict=True))


def start(given: dict[str, Any]) -> Start:
    """What the page begins with."""
    plant, robots, course, controller = {**DEFAULTS.always}, {}, {}, {}
    for name, value in given.items():
        kind = next(
            into
            for fields, into in (
                ({"first", "second"}, robots),
                ({"seed"}, course),
                (SimulationParameters.model_fields, plant),
                (ControllerParameters.model_fields, controller),
            )
            if name in fields
        )
        kind[name] = value
    base = SimulationParameters.model_validate(plant)
    settings = settings_of(base, **robots, **course)
    return Start(settings=settings, plant=base, controller=ControllerParameters.model_validate(controller))


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
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    for source in ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]:
        exec(source.replace("RUNS = 3", "RUNS = 1"), space)  # as Jupyter does
    assert {"mass", "gain", "width", "friction", "push", "noise", "delay", "learning"} <= space["shares"].keys()
    assert all(0 <= share <= 1 for curves in space["shares"].values() for curve in curves.values() for share in curve)
    assert space["shares"]["mass"]["best"][2] == 1  # twice the mass
