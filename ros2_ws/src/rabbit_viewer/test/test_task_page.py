"""A cart before a wall on the page: the numbers of its rows, and what a person changes while it rides."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, System
from own_cart import CART, LIMIT
from played import Played
from rabbit_description.task import ControlTask
from rabbit_description.task_source import load_task
from rabbit_recording.explaining import explain_ride
from rabbit_viewer.page.ride import RideRows
from rabbit_viewer.play.serving import Door
from rabbit_viewer.play.task_player import Start, TaskPlayer, altered, check_asked, rates_of, settings_of
from rabbit_viewer.state_picture import StatePicture
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.task_episode import ride_of

EXAMPLES = Path(__file__).resolve().parents[4] / "examples"


@pytest.fixture
def start(tmp_path: Path) -> Start:
    """The cart under both controllers."""
    path = tmp_path / "cart.py"
    path.write_text(CART)
    return Start(str(path), ("nominal", "oracle"), 3)


def test_a_row_has_each_row_of_the_qp(start: Start) -> None:
    task = load_task(start.source)
    rows, ride = RideRows(task), ride_of(TaskController(task), "nominal", 3)
    told = [dict(zip(rows.columns, rows.row(k, m), strict=True)) for k, m in enumerate(ride.moments)]
    for now, m in zip(told, ride.moments, strict=True):
        assert (now["u_u1"], now["wall"]) == (m.u[0], m.output.barriers[0])
        assert {name for name in ("CLF", "wall", "u1") if now[f"active_{name}"] == 0} == set(m.decided.active)
        assert now["margin_u1"] == pytest.approx(LIMIT - abs(m.u[0]), abs=1e-6)
        for name in ("CLF", "wall", "u1"):  # complementary slackness
            assert abs(now[f"multiplier_{name}"] * now[f"margin_{name}"]) < 1e-5 * (1 + now[f"multiplier_{name}"])
    assert any("wall" in m.decided.active for m in ride.moments)


def test_what_is_played_is_the_ride_in_process(start: Start) -> None:
    played, task = Played(TaskPlayer, start).go_on(), load_task(start.source)
    for i, name in enumerate(start.controllers):
        ride, found = ride_of(TaskController(replace(task)), name, 3), played.rows(i)
        expected = np.array([m.u[0] for m in ride.moments], dtype=np.float32)
        np.testing.assert_array_equal(found["u_u1"][: len(expected)], expected)
        (word,) = (word for word in played.words["ended"]["walkers"] if word["reason"].startswith(name))
        assert word["outcome"] == "done"
        assert word["tick"] == np.argmin([m.output.barriers[0] for m in ride.moments])
        assert f"wall {'kept' if ride.is_kept else 'broken'}, at least {ride.margins[0]:.3g} at" in word["reason"]


def test_a_true_parameter_acts_at_once_and_the_oracle_knows_it(start: Start) -> None:
    played = Played(TaskPlayer, start).go_on(40)
    before = played.rows(1)
    played.ask("set", settings={"true_mass": 4.0})
    assert played.words["state"]["waiting"] == []
    played.go_on(60)
    after, (_, oracle) = played.rows(1), played.player.walkers
    np.testing.assert_array_equal(after["u_u1"][:40], before["u_u1"])
    x, u = (np.array([getattr(m, name) for m in oracle._ride.moments]) for name in ("x", "u"))
    gained, pushed = np.diff(x[:, 1]), 0.01 * u[:-1, 0]
    np.testing.assert_allclose(2.0 * gained[:40], pushed[:40], atol=1e-9)
    np.testing.assert_allclose(4.0 * gained[40:], pushed[40:], atol=1e-9)
    assert np.abs(pushed[40:]).max() > 0.01
    assert played.go_on().words["ended"]["walkers"][1]["reason"].count("wall kept") == 1


def test_what_is_commanded_changes_with_the_next_ride(start: Start) -> None:
    played = Played(TaskPlayer, start).go_on(10)
    played.ask("set", settings={"added_target": -0.5, "second": "none", "again": "same course"})
    assert set(played.words["state"]["waiting"]) == {"added_target", "second"}
    assert len(played.words["about"]["walkers"]) == 2
    played.ask("reset")
    played.go_on(1000)
    assert len(played.words["about"]["walkers"]) == 1
    (ride,) = played.player.walkers
    assert {m.p[1] for m in ride._ride.moments} == {1.2 - 0.5}


def test_a_rate_follows_the_pace() -> None:
    """At each pace the published speed of the obstacle is the derivative of its place."""
    task = load_task(str(EXAMPLES / "obstacle_arm.py"))
    assert rates_of(task) == {"speed_x", "speed_z"}
    model, commands = settings_of(task, Start("", ("nominal",), 1)), task.commands(np.random.default_rng(1))
    shown = [name.removeprefix("added_") for name in model.model_fields if name.startswith("added_")]
    assert shown == [name for name in commands(0.0) if not name.startswith("speed")]  # in the order of the task
    settings = model.model_validate({"pace": 2.5, "added_place_x": 0.1})
    at, h = partial(altered(task, settings, lambda t, _: commands(t)), impacts=0), 1e-6
    for t in (0.0, 0.7, 3.0):
        for axis in "xz":
            slope = (at(t + h)[f"place_{axis}"] - at(t - h)[f"place_{axis}"]) / (2 * h)
            assert at(t)[f"speed_{axis}"] == pytest.approx(slope, abs=1e-7)
    assert at(0.4)["place_x"] == pytest.approx(commands(1.0)["place_x"] + 0.1)


def test_a_tick_is_explained_live_as_in_process(start: Start) -> None:
    played = Played(TaskPlayer, start).go_on(80)
    played.ask("explain", walker=0, tick=60)
    lines = played.words["explained"]["lines"]
    assert lines == explain_ride(ride_of(TaskController(load_task(start.source)), "nominal", 3), 60).lines()
    assert lines[:2] == ["cart, nominal, tick 60 (0.60 s)", "answered by daqp"]
    played.ask("explain", walker=0, tick=600)
    assert "expected one from 0 to 79" in played.words["explained"]["lines"][0]


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({"do": "push", "force": 1}, "push"),
        ({"do": "set", "settings": {"true_mass": 1e9}}, "true_mass 1000000000.0: expected less than or equal to 5"),
        ({"do": "set", "settings": {"true_mass": "NaN"}}, "true_mass NaN: expected a finite number"),
        ({"do": "set", "settings": {"mass": 1}}, "mass"),
        ({"do": "begin", "settings": {"first": "/etc/passwd"}}, "first"),
    ],
)
def test_the_door_refuses_in_one_line(start: Start, message: dict[str, Any], said: str) -> None:
    passed = list[Any]()
    settings = settings_of(load_task(start.source), start)
    line = Door(partial(check_asked, settings), passed.append)(json.dumps(message))
    assert said in line
    assert "\n" not in line
    assert passed == []


def test_a_task_without_draw_shows_its_state_and_where_its_barriers_are_zero() -> None:
    """In the plane of x and dx: a wall is a vertical line, an ellipse an ellipse; what depends on more is not drawn."""
    x, v, w, u, wall = (ca.SX.sym(name) for name in ("x", "v", "w", "u", "wall"))
    system = System(ca.vertcat(x, v, w), u, ca.vertcat(v, w, u), [wall])
    shown = [Barrier("wall", wall - x, poles=(4, 4, 4)), Barrier("ellipse", 1 - x**2 - v**2 / 4, poles=(4, 4))]
    quantities = [*shown, Barrier("w", 1 - w, poles=(4,))]
    start = ((-0.2, -0.4, 0), (0.2, 0.4, 0))
    given = {"nominal": {}, "true": {}, "start": start, "commands": lambda rng: lambda t: {"wall": 0.7}}
    picture = StatePicture(ControlTask("w", system, quantities, **given))
    frame, *curves, state = picture.shapes(np.array([0.1, 0.2, 9.0]), np.array([0.7]))
    half = np.array([0.1, 0.2]) / state.centre  # of the frame, which is around 0
    points = [np.asarray(curve.points) * half for curve in curves]
    assert np.abs(np.asarray(frame.points)).max() == 1
    straight, round_ = sorted(points, key=lambda line: np.ptp(line[:, 0]))
    np.testing.assert_allclose(straight[:, 0], 0.7, atol=1e-9)
    np.testing.assert_allclose(round_[:, 0] ** 2 + round_[:, 1] ** 2 / 4, 1, atol=0.03)
    assert picture.note[0] == "x1 to the right, x2 up"
