"""A task of one's own in a real browser: it rides, its controls act, and its file opens from disk."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import Chromium
from served import Served

CART_POLE = str(Path(__file__).resolve().parents[2] / "examples" / "cart_pole.py")
INK = """(() => {
  const canvas = document.querySelectorAll('#scenes canvas')[%d];
  const data = canvas.getContext('2d').getImageData(0, 60, canvas.width, canvas.height - 60).data;
  return new Set(new Uint32Array(data.buffer)).size;
})()"""


@pytest.fixture
def played() -> Iterator[str]:
    """The address of a played task."""
    served = Served("system", "play", CART_POLE)
    yield served.address
    assert served.end() == 0


def test_a_task_rides_and_a_person_changes_it(chromium: Chromium, played: str) -> None:
    page = chromium.open(played)
    page.wait("rabbit.clock.row > 30 && rabbit.controls.state")
    assert page.look(INK % 0) > 3
    assert page.look(INK % 1) > 3
    assert page.look("document.querySelector('#push-on')") is None
    page.drag("#true_pole", 0.9)
    page.wait("rabbit.controls.state.settings.true_pole > 1.5 && !rabbit.controls.state.waiting.includes('true_pole')")
    page.drag("#added_wall", 0.9)
    page.wait("rabbit.controls.state.waiting.includes('added_wall')")
    page.choose("#row", "1")
    page.wait("rabbit.plots.plots.some(({columns}) => columns.includes('margin_wall'))")
    assert page.look("rabbit.plots.plots.some(({columns}) => columns.includes('multiplier_wall'))")
    page.click("#reset")
    page.wait("!rabbit.controls.state.waiting.length && rabbit.clock.row > 5")
    page.wait("Object.keys(rabbit.state.ended).length")
    page.click("#things button")
    page.wait("!document.querySelector('#why').hidden")
    assert "row     asks" in page.look("document.querySelector('#why pre').textContent")
    assert page.errors == []
