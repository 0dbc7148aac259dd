"""Courses, their files, where the stones lie, and where feet come down on them, substep by substep."""

import numpy as np
import pytest
from rabbit_description.state import Leg
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import SUBSTEPS, Span
from rabbit_sim.stones import CourseError, Stone, draw_course, read_course
from rabbit_sim.terrain import Ground, Terrain
from rabbit_sim.touchdown_detector import TouchdownDetector


def test_normal_course_has_the_truncated_normals_moments():
    """Variance of a normal cut at +-2.5: 1 - 2 a phi(a) / (2 Phi(a) - 1) = 0.9113 of the whole one's."""
    p = SimulationParameters(stones=4000, l_min_mean=0.35, l_min_std=0.02)
    edges = np.array([stone.l_min for stone in draw_course(p, np.random.default_rng(0))])
    assert np.abs(edges - 0.35).max() <= 2.5 * 0.02
    assert edges.mean() == pytest.approx(0.35, abs=4 * 0.02 / np.sqrt(4000))
    assert edges.std() == pytest.approx(0.02 * np.sqrt(0.9113), rel=0.05)


def test_course_files(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("stones: [{l_min: 0.3, l_max: 0.36}, {l_min: 0.4}]")
    first, second = read_course(path, 2, 0.05)
    assert (first.l_min, first.l_max) == (0.3, 0.36)
    assert (second.l_min, second.l_max) == pytest.approx((0.4, 0.45))
    assert read_course(path, 1, 0.05) == [first]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("stones: [{l_min: 0.3}, {l_min: .nan}]", "stones[1].l_min = nan"),
        ("stones: [{l_min: 0.3, width: 1}, {l_min: 0.4}]", "stones[0].width"),
        ("stones: [{l_min: 0.3}, {l_min: x}]", "stones[1].l_min = x"),
        ("- 0.3", "expected names, each with a value"),
    ],
)
def test_bad_course_files_are_refused_by_name(tmp_path, text, expected):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(CourseError) as error:
        read_course(path, 2, 0.05)
    assert expected in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("previewed", [True, False])
def test_stones_follow_the_foot_and_heights_are_absolute_and_previewed_from_the_stone_before(previewed):
    course = [Stone(l_min=0.3, l_max=0.36, height=0.02), Stone(l_min=0.4, l_max=0.44, height=-0.03)]
    terrain = Terrain(SimulationParameters(stones=2, height_preview=previewed), course)
    first, second = terrain.place_next(1, 0.0), terrain.place_next(2, 0.31)
    assert (second.index, second.l_min, second.l_max) == pytest.approx((2, 0.4, 0.44))
    assert terrain.placed[-1] == pytest.approx((0.71, 0.75, -0.03))
    assert [span.top for span in terrain.placed] == [0.0, 0.02, -0.03]
    assert [first.height, second.height] == pytest.approx([0.02, -0.05] if previewed else [0.0, 0.0])


STANDS = (0.0, 0.0)
NO_FORCE, ON_LEFT = [0.0, 0.0], [[0.0, 300.0], [0.0, 0.0]]


class Fall:
    """The left foot stands; the right one moves at (0.3, -speed) mm a substep from (0.1, height), m."""

    def __init__(self, height: float, speed: float, *stones: Span) -> None:
        self.height, self.speed, self.now = height, speed, 0
        self.detector = TouchdownDetector(self.feet)
        self.detector.ground = Ground(stones)

    def feet(self):
        return STANDS, (0.1 + 3e-4 * self.now, self.height - 1e-3 * self.speed * self.now)

    def tick(self, right=lambda: NO_FORCE):
        """Touches of the next tick; `right()` is the force on the right foot."""
        self.detector.begin_tick(self.feet())
        for _ in range(SUBSTEPS):
            self.now += 1
            self.detector.substep([ON_LEFT[0], right()])
        return self.detector.touches


@pytest.mark.parametrize("speed", [0.3, 1.0, 2.7, 4.9])
@pytest.mark.parametrize("height", [0.006, 0.0213, 0.048])
def test_a_foot_that_falls_through_the_ground_came_down_where_its_height_was_zero(height, speed):
    fall = Fall(height, speed)
    touches = []
    while not touches:
        touches = fall.tick()
    (touch,) = touches
    assert (touch.leg, touch.hold) == (Leg.RIGHT, False)
    assert touch.x == pytest.approx(0.1 + 0.3 * height / speed, abs=1e-12)
    assert touch.other_x == 0.0


def test_a_foot_on_a_stone_came_down_where_it_was_when_it_first_pressed():
    fall = Fall(0.0085, 1.0)
    (touch,) = fall.tick(lambda: [0.0, 50.0] if fall.now >= 9 else NO_FORCE)
    assert touch.hold
    assert touch.x == pytest.approx(0.1 + 9 * 3e-4)


PLATFORM = Span(-1.0, 0.025)


def touches_of(fall, ticks, right=lambda: NO_FORCE):
    return [touch for _ in range(ticks) for touch in fall.tick(right)]


def test_a_foot_that_sinks_into_the_stone_under_it_is_not_in_a_gap():
    """Ground that gives carries next to nothing at first; once it carries, the foot has come down on the stone."""
    fall = Fall(0.006, 0.25, PLATFORM, Span(0.09, 0.14))
    pressing = touches_of(fall, 6, lambda: [0.0, 50.0] if fall.now >= 30 else NO_FORCE)
    (touch,) = pressing
    assert touch.hold
    assert fall.now == 60
    assert fall.feet()[1][1] < -0.008  # below by more than an edge's depth: sunk, still on its stone


@pytest.mark.parametrize(("top", "mouth"), [(0.03, 0.0), (-0.03, -0.03)])
def test_a_gap_begins_at_the_lower_of_the_tops_beside_it(top, mouth):
    """The right foot falls at x = 0.1 to 0.13, between the platform and the stone."""
    fall = Fall(0.05, 1.0, PLATFORM, Span(0.2, 0.25, top))
    (touch,) = touches_of(fall, 12)
    assert not touch.hold
    assert touch.x == pytest.approx(0.1 + 0.3 * (0.05 - mouth), abs=1e-12)


@pytest.mark.parametrize(("top", "substep", "hold"), [(0.02, 30, True), (-0.02, 70, True), (0.04, 30, False)])
def test_a_foot_holds_on_a_top_and_not_at_a_side(top, substep, hold):
    """Pressed first at a height of 50 - substep mm beside or on a stone with this top."""
    fall = Fall(0.05, 1.0, PLATFORM, Span(0.1, 0.15, top))
    (touch,) = touches_of(fall, 8, lambda: [0.0, 50.0] if fall.now >= substep else NO_FORCE)
    assert touch.hold is hold
