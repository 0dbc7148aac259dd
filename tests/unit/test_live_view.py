"""The live view for RViz: what is drawn lies where the walk's records have it."""

import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rabbit_common.ros.conversions import stamp
from rabbit_description import URDF_PATH
from rabbit_description.state import StonePreview
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import record_walk
from rabbit_experiments.walk_records import WalkRecords
from rabbit_msgs import msg
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.live.snapshot import Limits, Snapshot
from rabbit_viewer.ros.markers import WORLD, markers, transforms
from rabbit_viewer.ros.newest_ticks import KEPT, TickMessages
from rabbit_viewer.scene import stone_spans
from rabbit_viewer.skeleton import feet
from rl_cbf_clf_controller.parameters import load_parameters
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker

LIMITS = Limits(
    **{"R1": 1.0, "R2": 0.5, "stone_margin": 0.005, "friction_coeff": 0.8, "link_bend": 0.0, "friction_margin": 0.2},
    **{"torque_limit": 200.0, "eps": 0.04, "kp": 0.5, "kd": 0.87},
)
RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def walk() -> WalkRecords:
    """Three stones."""
    plant = SimulationParameters.model_validate({"stones": 3})
    return record_walk(Assembly(plant, load_parameters("ours", controller="cbf-clf-qp"), "zero"), seed=1)


def snapshot_at(walk: WalkRecords, row: int) -> Snapshot:
    """A row of the records as the viewer sees it."""
    landed = walk.landings[walk.landings[:, 0] <= walk.touchdowns[row]]
    tick = int(walk.tick[row])
    state = msg.RabbitState(
        stamp=stamp(tick),
        episode=1,
        tick=tick,
        q=walk.q[row],
        foot_force=walk.foot_force[row].ravel(),
        touchdowns=int(walk.touchdowns[row]),
        applied=walk.torque[row],
    )
    details = msg.ControllerState(
        stance=int(walk.stance[row]),
        clf=float(walk.V[row]),
        barriers=walk.barriers[row],
        clf_slack=float(walk.clf_slack[row]),
        rescue_slack=float(walk.rescue_slack[row]),
        policy_version="zero",
    )
    stone = StonePreview(0, *walk.preview[row]) if np.isfinite(walk.preview[row, 0]) else None
    landings = tuple(msg.Landing(l=row[2], l_min=row[3], l_max=row[4]) for row in landed)
    return Snapshot(state, details, 3, stone, landings, LIMITS)


def drawn(snapshot: Snapshot, group: str) -> list[Marker]:
    """The markers of a group."""
    return [marker for marker in markers(snapshot).markers if marker.ns == group]


def edges(box: Marker) -> tuple[float, float]:
    """Where a box begins and ends."""
    return (box.pose.position.x - box.scale.x / 2, box.pose.position.x + box.scale.x / 2)


def points(marker: Marker) -> Any:
    """A marker's points (n, 2), x and z."""
    assert not any(point.y for point in marker.points)
    return np.array([(point.x, point.z) for point in marker.points])


def test_stones_lie_where_the_film_has_them(walk: WalkRecords) -> None:
    """The film sees the whole walk; the viewer lays them out backwards from the foot that stands."""
    spans = stone_spans(walk, feet(walk.q))
    for row in range(0, len(walk.tick), 7):
        boxes = [edges(box) for box in drawn(snapshot_at(walk, row), "stones")]
        expected = [span[:2] for span in spans[: int(walk.step_index[row]) + 2]]
        np.testing.assert_allclose(boxes, expected, atol=5e-3)  # each landing yields a millimetre


def test_a_viewer_that_came_late_draws_the_stones_it_knows_of(walk: WalkRecords) -> None:
    row = int(walk.step_starts[2])
    snapshot = snapshot_at(walk, row)
    late = replace(snapshot, landings=snapshot.landings[-1:])
    assert [*map(edges, drawn(late, "stones"))] == [*map(edges, drawn(snapshot, "stones"))][-2:]


def test_flat_ground_lies_under_the_foot(walk: WalkRecords) -> None:
    (ground,) = drawn(replace(snapshot_at(walk, 3), stone=None, landings=()), "stones")
    near, far = edges(ground)
    assert near < feet(walk.q[3:4])[0, 0, 0] < far


def test_force_begins_in_the_stance_foot_and_lies_in_the_cone(walk: WalkRecords) -> None:
    for row in range(5, len(walk.tick), 11):
        snapshot = snapshot_at(walk, row)
        (arrow,), (cone,) = drawn(snapshot, "force"), drawn(snapshot, "cone")
        start, tip = points(arrow)
        foot = RabbitFeet().positions(snapshot.q)[snapshot.stance]
        np.testing.assert_allclose([start, points(cone)[0]], [foot, foot], atol=1e-12)
        x, z = tip - start
        assert x * snapshot.force[1] == pytest.approx(z * snapshot.force[0])
        slope = points(cone)[1] - foot
        assert (abs(x) <= LIMITS.friction_coeff * z) == (abs(x) * slope[1] <= z * slope[0])


def test_without_parameters_nothing_is_invented(walk: WalkRecords) -> None:
    snapshot = replace(snapshot_at(walk, 3), limits=None)
    assert not drawn(snapshot, "area")
    assert not drawn(snapshot, "cone")
    assert len(drawn(snapshot, "robot")) == 3


def test_frames_carry_the_links_to_where_the_feet_are(walk: WalkRecords) -> None:
    snapshot = snapshot_at(walk, 3)
    for q in RNG.uniform(-1, 1, (10, 7)):
        snapshot.state.q = q
        at: dict[str, tuple[Any, Any]] = {WORLD: (np.zeros(3), Rotation.identity())}
        for frame in transforms(snapshot).transforms:
            origin, turned = at[frame.header.frame_id]
            moved, turn = frame.transform.translation, frame.transform.rotation
            place = origin + turned.apply([moved.x, moved.y, moved.z])
            at[frame.child_frame_id] = (place, turned * Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]))
        placed = [at[name][0][[0, 2]] for name in ("left_foot", "right_foot")]
        np.testing.assert_allclose(placed, RabbitFeet().positions(q), atol=1e-12)
    links = {line.split('"')[1] for line in URDF_PATH.read_text().splitlines() if "<link name=" in line}
    assert set(at) == links


def message(episode: int, tick: int) -> bytes:
    """The beginning that all of a tick's messages have: CDR header, stamp, episode, tick."""
    return b"\0\1\0\0" + struct.pack("<iIII", 0, 0, episode, tick) + b"rest"


def test_parts_of_different_ticks_are_not_mixed() -> None:
    ticks = TickMessages("a", "b")
    ticks.add("a", message(1, 7))
    ticks.add("b", message(1, 8))
    assert ticks.key is None
    ticks.add("a", message(1, 8))
    assert ticks.key == (1, 8)
    assert ticks.parts == {"a": message(1, 8), "b": message(1, 8)}
    assert not ticks.earlier
    for part in "ab":
        ticks.add(part, message(1, 9))
    assert ticks.earlier == [{"a": message(1, 8), "b": message(1, 8)}]
    ticks.add("a", b"short")
    for tick in range(100, 110 + KEPT):
        ticks.add("a", message(1, tick))
    ticks.add("b", message(1, 100))  # forgotten by then
    assert ticks.key == (1, 9)
    ticks.clear()
    assert ticks.key is None


def test_lines_of_the_robot_meet_in_the_hip(walk: WalkRecords) -> None:
    snapshot = snapshot_at(walk, 3)
    for line in drawn(snapshot, "robot"):
        np.testing.assert_array_equal(points(line)[0], snapshot.q[:2])
