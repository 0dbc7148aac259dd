"""Feet on written ways, substep by substep."""

import pytest
from rabbit_description.state import Leg
from rabbit_sim.plant import SUBSTEPS
from rabbit_sim.touchdown_detector import TouchdownDetector

STANDS = (0.0, 0.0)
NO_FORCE, ON_LEFT = [0.0, 0.0], [[0.0, 300.0], [0.0, 0.0]]


class Fall:
    """The left foot stands; the right one moves at (0.3, -speed) mm a substep from (0.1, height), m."""

    def __init__(self, height: float, speed: float) -> None:
        self.height, self.speed, self.now, self.looks = height, speed, 0, 0
        self.detector = TouchdownDetector(self.look)

    def feet(self):
        return STANDS, (0.1 + 3e-4 * self.now, self.height - 1e-3 * self.speed * self.now)

    def look(self):
        self.looks += 1
        return self.feet()

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


def test_a_high_foot_is_not_looked_at():
    fall = Fall(0.04, 0.0)
    fall.tick()
    assert fall.looks == 1
    fall.height = 0.2
    fall.tick()
    assert fall.looks == 1
