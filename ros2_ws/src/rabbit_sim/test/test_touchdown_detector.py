"""Feet on written ways, substep by substep."""

import pytest
from rabbit_description.state import Leg
from rabbit_sim.plant import SUBSTEPS, Span
from rabbit_sim.terrain import Ground
from rabbit_sim.touchdown_detector import TouchdownDetector

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
