"""What pictures and films show: the ground as it is, a limp fall by the laws of mechanics; files that open."""

import runpy
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import pinocchio
import pytest
from rabbit_description.state import Array
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import record_walk
from rabbit_experiments.walk_records import ARRAYS, PLANT, RECORDS, WalkRecords, save_records
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import gravity
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_viewer.commands.video import app
from rabbit_viewer.geometry import feet, torso_points
from rabbit_viewer.limp_fall import COMPUTED_FROM, LYING, with_fall
from rabbit_viewer.scene import SIZE, Scene
from rabbit_viewer.walk_pictures import draw_pictures
from rl_cbf_clf_controller.parameters import load_parameters
from typer.testing import CliRunner


def walk_on(controller: str) -> WalkRecords:
    """Two steps."""
    parameters = load_parameters("ours", controller=controller)
    terrain = parameters.terrain
    plant = SimulationParameters.model_validate({"terrain": terrain, "stones": 2})
    return record_walk(Assembly(plant, parameters, "zero"), seed=1)


@pytest.mark.parametrize(("controller", "count"), [("cbf-clf-qp", 7), ("clf-qp", 6)])
def test_every_picture_opens(controller: str, count: int, tmp_path: Path) -> None:
    save_records(walk_on(controller), tmp_path / RECORDS)
    pictures = draw_pictures(tmp_path)
    assert len(pictures) == count
    for picture in pictures:
        assert imageio.imread(picture).std() > 1  # not blank


def test_a_slope_is_drawn_as_steep_as_it_is() -> None:
    """On flat ground the stance foot's ground is a level line; on a slope of 20 degrees it rises by their tangent."""
    flat = walk_on("clf-qp")
    tops = []
    for slope in (0.0, 20.0):
        picture = Scene(replace(flat, about={**flat.about, "slope": slope}), has_legend=False).frame(0)[260:, :, :3]
        ground = (picture.astype(int) - 0x8C).__abs__().max(axis=2) < 8  # the stones' grey
        tops.append([np.flatnonzero(ground[:, column])[0] for column in (300, 660)])
    assert tops[0][0] == tops[0][1]
    rise = (tops[1][0] - tops[1][1]) / 360
    assert rise == pytest.approx(np.tan(np.radians(20.0)), abs=0.02)


HEAVY: dict[str, Any] = {"mass_scale": 2.0, "stones": 6}
FALLS = {
    "stones": HEAVY,
    "flat": HEAVY | {"terrain": "flat", "mass_scale": 3.0},
    "hill": HEAVY | {"terrain": "flat", "mass_scale": 3.0, "slope": 8.0},
    "mujoco": HEAVY | {"plant": "mujoco"},
}


@cache
def fallen(case: str) -> WalkRecords:
    """The nominal robot falls."""
    plant = SimulationParameters.model_validate(FALLS[case])
    own = load_parameters("ours", controller="clf-qp" if plant.terrain == "flat" else "cbf-clf-qp")
    return record_walk(Assembly(plant, own, "zero"), seed=1)


def energy(walk: WalkRecords) -> Array:
    """Of each tick's state in the true robot, J."""
    plant = SimulationParameters.model_validate(walk.about[PLANT])
    model = pinocchio.buildModelFromXML(perturbed_urdf(plant))
    model.gravity.linear = np.array([*gravity(plant.slope)]) @ [[1, 0, 0], [0, 0, 1]]
    data = model.createData()
    states = zip(walk.q, walk.dq, strict=True)
    return np.array([pinocchio.computeMechanicalEnergy(model, data, q, dq) for q, dq in states])


@pytest.mark.parametrize("case", FALLS)
def test_a_limp_robot_falls_to_the_ground_and_gains_no_energy(case: str) -> None:
    walk = fallen(case)
    longer, end = with_fall(walk), len(walk.tick)
    assert longer.about[COMPUTED_FROM] == end
    for name in ARRAYS.keys() - {"landings"}:
        np.testing.assert_array_equal(getattr(longer, name)[:end], getattr(walk, name), err_msg=name)
    np.testing.assert_array_equal(np.diff(longer.tick), 1)
    assert not longer.torque[end:].any()
    assert np.isnan(longer.V[end:]).all()
    limp = energy(longer)[end:]  # the first of them is where the last recorded torque has brought it
    assert np.diff(limp).max() < 0.2  # J, of some 100: a contact's spring gives back what it took
    assert limp[-1] < limp[0]
    assert torso_points(longer.q[-1:])[0, :, 1].min() < LYING
    assert feet(longer.q[end:])[:, :, 1].min() > -0.01 or walk.about["terrain"] == "stones"  # gaps have no ground


WriteBag = Callable[..., Path]


def test_a_recording_becomes_mp4_and_gif(tmp_path: Path, write_bag: WriteBag) -> None:
    done = CliRunner().invoke(app, [str(write_bag(tmp_path / "bag")), "--speed", "4"])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines() == [str(tmp_path / "bag.mp4"), str(tmp_path / "bag.gif")]
    frames = imageio.imread(tmp_path / "bag.mp4", plugin="FFMPEG")
    assert frames.shape[1:] == (SIZE[1], SIZE[0], 3)
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100
    assert len(imageio.imread(tmp_path / "bag.gif", index=None)) > 1


@pytest.mark.parametrize("words", [("nowhere",), (".",), ("bag", "--episode", "9")])
def test_no_walk_is_one_line(
    tmp_path: Path, write_bag: WriteBag, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_bag(tmp_path / "bag")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty" if words == (".",) else tmp_path)
    done = CliRunner().invoke(app, [*words])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output


EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "read_recording.py"


def test_it_reads_all_ticks_and_draws_them(
    walk, write_bag, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag")
    monkeypatch.setattr(sys, "argv", ["read_recording.py", str(bag)])
    seen = runpy.run_path(str(EXAMPLE))
    assert [tick.state.tick for tick in walk.records] == seen["ticks"].tolist()
    assert [tick.output.V for tick in walk.records] == seen["V"].tolist()
    said = capsys.readouterr().out
    assert f"episode 1: walked, {len(walk.records)} ticks" in said
    assert "policies: ['zero']" in said
    assert (tmp_path / "bag-episode-1.png").stat().st_size > 1000
