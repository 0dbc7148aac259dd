"""The examples run as they stand, for a few steps, and show what they claim."""

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest

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


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_cruise_control_keeps_the_limit_with_a_perfect_estimate(scale):
    cruise = load("cruise_control")
    speeds = cruise.drive(scale, perfect=True)
    assert max(speeds) <= cruise.V_LIMIT + 1e-6
    assert speeds[-1] == pytest.approx(cruise.V_LIMIT, abs=0.01)


def test_cruise_control_of_a_lighter_car_breaks_the_limit_without_it():
    cruise = load("cruise_control")
    assert max(cruise.drive(0.5, perfect=False)) > cruise.V_LIMIT + 0.05


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
    told, said = page.split("```text\n")[1].split("```")[0], capsys.readouterr().out
    number = re.compile(r"(?<=\s)-?\d+(?:\.\d+)?(?=\s)")
    assert number.sub("", told).split() == number.sub("", said).split()
    numbers = [[float(each) for each in number.findall(text)] for text in (told, said)]
    assert numbers[1] == pytest.approx(numbers[0], rel=0.02)
    B1, dB1 = (float(each) for each in re.search(r"^B1 \(m\), B1' +(\S+) +(\S+)", said, re.MULTILINE).groups())
    required = float(re.search(r"^-K_b .* (\S+)$", said, re.MULTILINE)[1])
    assert required == pytest.approx(-4900 * B1 - 140 * dB1, rel=0.02)
    assert float(re.search(r"^B1'' estimated +(\S+)", said, re.MULTILINE)[1]) == pytest.approx(required, rel=0.01)
