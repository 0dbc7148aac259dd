"""What pictures show: the feet and stones where they were; files that open."""

from dataclasses import replace
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import record_walk
from rabbit_experiments.walk_records import RECORDS, WalkRecords, save_records
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.scene import Scene
from rabbit_viewer.walk_pictures import draw_pictures
from rl_cbf_clf_controller.parameters import load_parameters


def walk_on(controller: str) -> WalkRecords:
    """Two steps."""
    parameters = load_parameters("ours", controller=controller)
    terrain = parameters.terrain
    plant = SimulationParameters.model_validate({"terrain": terrain, "stones": 2})
    return record_walk(Assembly(plant, parameters, "zero"), seed=1)


@pytest.fixture(scope="module")
def walk() -> WalkRecords:
    return walk_on("cbf-clf-qp")


@pytest.mark.parametrize(("controller", "count"), [("cbf-clf-qp", 7), ("clf-qp", 6)])
def test_every_picture_opens(controller: str, count: int, tmp_path: Path) -> None:
    save_records(walk_on(controller), tmp_path / RECORDS)
    pictures = draw_pictures(tmp_path)
    assert len(pictures) == count
    for picture in pictures:
        assert imageio.imread(picture).std() > 1  # not blank


def test_a_slope_is_drawn_as_steep_as_it_is(walk: WalkRecords) -> None:
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
