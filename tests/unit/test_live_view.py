"""What RViz and a page's rows show lies where the walk's records and the plant have it."""

from typing import Any

import numpy as np
import pytest
from rabbit_common.ros.conversions import WORLD, foot_wrench, header
from rabbit_common.ros.robot_frames import transforms
from rabbit_description import FRAMES, URDF_PATH
from rabbit_description.state import FEET, Array, StonePreview
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.walk_records import WalkRecords, about_walk
from rabbit_msgs import msg
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rabbit_viewer.geometry import spans_until, stone_spans
from rabbit_viewer.page.rows import RowMaker
from rabbit_viewer.ros.rviz import markers
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.rollout import Record
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker
from walked import walked as walk_of

RNG = np.random.default_rng(0)


CONTROLLER = ControllerParameters(controller="cbf-clf-qp")
PLANT = SimulationParameters(stones=3, stone_height=0.015)
Walked = tuple[list[Record], Simulation]


@pytest.fixture(scope="module")
def walked() -> Walked:
    """Three stones."""
    return walk_of(Assembly(PLANT, CONTROLLER, "zero"), 1)


@pytest.fixture(scope="module")
def walk(walked: Walked) -> WalkRecords:
    """The same as arrays."""
    records, simulation = walked
    return WalkRecords.from_ticks(records, simulation.landings, about_walk(CONTROLLER, PLANT, "zero", 1, "walked"))


def state_at(walk: WalkRecords, row: int) -> msg.RobotState:
    """A row of the records as the simulator publishes it."""
    tick, landed = int(walk.tick[row]), int(walk.touchdowns[row])
    return msg.RobotState(header=header(tick), episode=1, tick=tick, q=walk.q[row], touchdowns=landed)


def boxes(walk: WalkRecords, row: int) -> list[tuple[float, ...]]:
    """Both ends and the top of each box of a row, for a viewer that has heard the landings so far."""
    landed = walk.landings[walk.landings[:, 0] <= walk.touchdowns[row]]
    heard = [msg.Landing(index=int(row[0]), l=row[2], l_min=row[3], l_max=row[4]) for row in landed]
    height = float(walk.stone_height[row])
    heights = {k: float(walk.stone_height[walk.step_starts[k - 1]]) for k in range(1, len(walk.step_starts) + 1)}
    ahead = StonePreview(0, *walk.preview[row], height) if np.isfinite(walk.preview[row, 0]) else None
    foot = RabbitFeet().positions(walk.q[row])[walk.stance[row]]
    first, *drawn = markers(state_at(walk, row), foot, ahead, heard, heights).markers
    assert first.action == Marker.DELETEALL
    spans = [(b.pose.position, b.scale) for b in drawn]
    return [(at.x - size.x / 2, at.x + size.x / 2, at.z + size.z / 2) for at, size in spans]


def test_stones_lie_where_the_film_has_them(walk: WalkRecords) -> None:
    """The film sees the whole walk; the viewer lays them out backwards from the foot that stands."""
    spans = stone_spans(walk)
    for row in range(0, len(walk.tick), 7):
        expected = [(near, far, top) for near, far, top, *_ in spans_until(walk, spans, row)]
        np.testing.assert_allclose(boxes(walk, row), expected, atol=5e-3)  # each landing yields a millimetre


def test_a_film_that_begins_late_has_the_same_next_stone(walked: Walked, walk: WalkRecords) -> None:
    records, simulation = walked
    begin = int(walk.step_starts[1]) + 3
    late = WalkRecords.from_ticks(records[begin:], simulation.landings, walk.about)
    for row in range(0, len(late.tick), 7):
        (*_, expected), (*_, found) = (
            spans_until(of, stone_spans(of), at) for of, at in ((walk, begin + row), (late, row))
        )
        np.testing.assert_allclose(found[:2], expected[:2], atol=5e-3)


def test_frames_carry_the_links_to_where_the_feet_are(walk: WalkRecords) -> None:
    state = state_at(walk, 3)
    for q in RNG.uniform(-1, 1, (10, 7)):
        state.q = q
        at: dict[str, tuple[Any, Any]] = {WORLD: (np.zeros(3), Rotation.identity())}
        for frame in transforms(state).transforms:
            origin, turned = at[frame.header.frame_id]
            moved, turn = frame.transform.translation, frame.transform.rotation
            place = origin + turned.apply([moved.x, moved.y, moved.z])
            at[frame.child_frame_id] = (place, turned * Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]))
        for names in (("left_foot", "right_foot"), ("l_sole", "r_sole")):
            placed = [at[name][0][[0, 2]] for name in names]
            np.testing.assert_allclose(placed, RabbitFeet().positions(q), atol=1e-12)
        np.testing.assert_allclose(at["base_link"][0][[0, 2]], q[:2], atol=1e-12)
        force = RNG.normal(size=2)
        for foot in range(len(FEET)):  # in its own frame; turned by that, it is the ground's
            angle = float(q[2] + q[3 + 2 * foot] + q[4 + 2 * foot])
            wrench = foot_wrench(force, angle, foot, state.header)
            x, z = wrench.wrench.force.x, wrench.wrench.force.z
            turned = at[wrench.header.frame_id][1].apply([x, 0, z])
            np.testing.assert_allclose(turned, [force[0], 0, force[1]], atol=1e-12)
    links = {line.split('"')[1] for line in URDF_PATH.read_text().splitlines() if "<link name=" in line}
    assert set(at) == links | FRAMES.keys()


def columns_of(records: list[Record], plant: SimulationParameters = PLANT, true: Any = None) -> dict[str, Array]:
    """By name, from all rows; `true`: the errors of the model, if the plant is known."""
    first, about = records[0].output, about_walk(CONTROLLER, plant, "", 1, "walked")
    maker = RowMaker(about, first.quantities, first.barrier_names, true is not None)
    errors = [None] * len(records) if true is None else true
    rows = [maker.row(r.state, r.output, true=error) for r, error in zip(records, errors, strict=True)]
    return dict(zip(maker.columns, np.transpose(rows), strict=True))


def test_stones_lie_where_the_plant_placed_them(walked: Walked) -> None:
    records, simulation = walked
    columns = columns_of(records)
    edges = np.transpose([columns[name] for name in ("stone_near", "stone_far", "stone_top")])
    seen = np.unique(edges[np.isfinite(edges[:, 0])], axis=0)
    np.testing.assert_allclose(seen, simulation.stones[1:], atol=5e-4)  # the foot goes on within its touchdown's tick


def test_with_exact_estimates_the_true_error_is_the_estimated_one() -> None:
    """Of the tick before, as everything that a tick says of the model's error."""
    plant = PLANT.model_copy(update={"mass_scale": 1.5})
    records, _ = walk_of(Assembly(plant, CONTROLLER, "oracle"), 1)
    column = columns_of(records, plant, [r.output.alpha @ r.output.mu + r.output.beta for r in records])
    for name in records[0].output.quantities:
        np.testing.assert_array_equal(column[f"true_{name}"], column[f"estimated_{name}"])
    assert np.isfinite(column["true_V"]).mean() > 0.9
