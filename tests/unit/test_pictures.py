"""What pictures show: joints where the robot's are, the barriers' area where the barriers are, files that open."""

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from rabbit_bringup.experiments.assembly import Assembly
from rabbit_bringup.experiments.evaluation import record_walk
from rabbit_bringup.viewing.geometry import ARC, allowed_area, area_triangles, force_arrow, friction_cone
from rabbit_bringup.viewing.pictures import RECORDS, draw_rollout, draw_run, swing_foot
from rabbit_bringup.viewing.scene import SIZE, Scene, stone_spans
from rabbit_bringup.viewing.skeleton import feet, leg_points, torso_points
from rabbit_bringup.viewing.video import as_gif, film
from rabbit_bringup.viewing.walk_records import ARRAYS, RecordsError, WalkRecords, load_records, save_records
from rabbit_description.state import Array, Leg, StonePreview
from rabbit_sim.kinematics import foot_positions
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.ecbf import stone_barriers
from rl_cbf_clf_controller.nominal_model import Kinematics
from rl_cbf_clf_controller.parameters import load_parameters

RNG = np.random.default_rng(0)
STATES = RNG.uniform(-1, 1, (20, 7))


def walk_on(controller: str) -> WalkRecords:
    """Two steps."""
    parameters = load_parameters("ours", controller=controller)
    terrain = "stones" if parameters.on_stones else "flat"
    plant = SimulationParameters.model_validate({"terrain": terrain, "stones": 2})
    return record_walk(Assembly(plant, parameters, "zero"), seed=1)


@pytest.fixture(scope="module")
def walk() -> WalkRecords:
    return walk_on("cbf-clf-qp")


@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_feet_are_where_the_plant_has_them(bend: float) -> None:
    expected = [foot_positions(q, bend) for q in STATES]
    assert feet(STATES, bend) == pytest.approx(np.array(expected))


def test_links_have_their_lengths() -> None:
    for leg in Leg:
        links = np.diff(leg_points(STATES, leg), axis=1)
        assert np.linalg.norm(links, axis=2) == pytest.approx(np.full((20, 2), 0.4))
    assert np.linalg.norm(np.diff(torso_points(STATES), axis=1), axis=2) == pytest.approx(np.full((20, 1), 0.63))


def barriers(point: Array, stone: StonePreview, R1: float, R2: float) -> Array:
    """B1, B2 of a swing foot at `point`."""
    none = np.zeros(2)
    return stone_barriers(Kinematics(point, none, np.zeros((2, 7)), none, none, none), stone, R1, R2).B


def test_area_is_bounded_by_the_barriers() -> None:
    stone, R1, R2 = StonePreview(1, 0.35, 0.40), 1.0, 0.5
    corners = allowed_area(stone.l_min, stone.l_max, R1, R2)
    values = np.array([barriers(corner, stone, R1, R2) for corner in corners])
    assert values.min() > -1e-12
    assert values[:ARC, 1] == pytest.approx(0, abs=1e-12)  # the inner circle
    assert values[ARC:-2, 0] == pytest.approx(0, abs=1e-12)  # the outer circle
    middle = np.array([stone.l_min / 2, 0.0])
    assert barriers(middle, stone, R1, R2)[1] < 0


def enclosed(corners: Array) -> float:
    """A polygon's area by the shoelace formula."""
    x, z = corners.T
    return abs(float(x @ np.roll(z, -1) - z @ np.roll(x, -1))) / 2


@pytest.mark.parametrize(("l_min", "R2"), [(0.35, 0.5), (0.25, 0.3), (0.45, 2.0)])
def test_triangles_fill_the_area(l_min: float, R2: float) -> None:
    corners = allowed_area(l_min, l_min + 0.05, 1.0, R2)
    triangles = area_triangles(corners)
    assert sum(enclosed(triangle) for triangle in triangles) == pytest.approx(enclosed(corners))
    middles = triangles.mean(axis=1)
    inside = [barriers(middle, StonePreview(1, l_min, l_min + 0.05), 1.0, R2).min() for middle in middles]
    assert min(inside) > -1e-3  # between two corners the edge is straight, the circles are not


def test_forces_on_the_cone_lie_on_its_edge() -> None:
    _, right, left = friction_cone(0.8)
    for edge, tangential in ((right, 240.0), (left, -240.0)):
        arrow = force_arrow(np.array([tangential, 300.0]))
        assert np.cross([*arrow, 0], [*edge, 0])[2] == pytest.approx(0)
    assert not force_arrow(np.zeros(2)).any()


def test_swing_foot_lands_where_the_simulator_says(walk: WalkRecords) -> None:
    before_landing = walk.step_starts[1] - 1
    length, height = swing_foot(walk)[before_landing]
    assert length == pytest.approx(walk.landings[0, 2], abs=0.02)  # one tick before, some cm/s
    assert height == pytest.approx(0, abs=0.02)


def test_stones_lie_where_the_feet_found_them(walk: WalkRecords) -> None:
    spans = stone_spans(walk, feet(walk.q))
    assert len(spans) == 3  # the platform and two stones
    row = walk.step_starts[1]
    near, far = spans[1]
    assert near < feet(walk.q)[row, walk.stance[row], 0] < far


def test_records_come_back_as_they_were(walk: WalkRecords, tmp_path: Path) -> None:
    save_records(walk, tmp_path / RECORDS)
    again = load_records(tmp_path / RECORDS)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(again, name), getattr(walk, name), err_msg=name)
    assert again.about == walk.about


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not a zip", b"nothing"])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / RECORDS).write_bytes(content)
    with pytest.raises(RecordsError, match="no records"):
        load_records(tmp_path / RECORDS)


def test_no_ticks_no_pictures(tmp_path: Path) -> None:
    with pytest.raises(RecordsError, match="no ticks"):
        draw_rollout([], [], tmp_path)


@pytest.mark.parametrize(("controller", "count"), [("cbf-clf-qp", 6), ("clf-qp", 5)])
def test_every_picture_opens(controller: str, count: int, tmp_path: Path) -> None:
    save_records(walk_on(controller), tmp_path / RECORDS)
    pictures = draw_run(tmp_path)
    assert len(pictures) == count
    for picture in pictures:
        assert imageio.imread(picture).std() > 1  # not blank


def test_film_and_gif_show_the_walk(walk: WalkRecords, tmp_path: Path) -> None:
    video = film(walk, tmp_path / "walk.mp4", speed=4.0)
    frames = imageio.imread(video, plugin="FFMPEG")
    assert frames.shape[1:] == (SIZE[1], SIZE[0], 3)
    assert frames.shape[0] >= len(walk.tick) / 16  # 25 frames a second at four times real time, then the last one
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100
    assert len(imageio.imread(as_gif(video), index=None)) > 1


def test_a_scene_draws_any_tick(walk: WalkRecords) -> None:
    scene = Scene(walk)
    first, later = scene.frame(0).copy(), scene.frame(len(walk.tick) - 1).copy()
    assert (first != later).any()
    np.testing.assert_array_equal(scene.frame(0), first)
