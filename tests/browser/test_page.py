"""The page in a real browser: every control is clicked, and what is drawn is looked at; a task of one's own."""

import re
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from chromium import Chromium, Page
from rabbit_command import RABBIT
from served import Served

WHY = "document.querySelector('#why pre').textContent"
DRAWN = "rabbit.state.pictures > 5 && rabbit.controls.state"


@pytest.fixture
def play() -> Iterator[Callable[..., str]]:
    """Plays under these options; the address."""
    with ExitStack() as stack:
        yield lambda *words: stack.enter_context(Served("play", *words)).address


def colours(page: Page, index: int = 0, below: int = 0) -> int:
    """How many colours a scene's canvas shows, but for its first rows of pixels."""
    script = f"""(() => {{
      const canvas = document.querySelectorAll('#scenes canvas')[{index}];
      const data = canvas.getContext('2d').getImageData(0, {below}, canvas.width, canvas.height - {below}).data;
      return new Set(new Uint32Array(data.buffer)).size;
    }})()"""
    return int(page.look(script))


def check_requests(page: Page) -> None:
    """No error in a script, and nothing was asked of another host."""
    assert page.errors == []
    assert page.requests
    assert not [url for url in page.requests if not re.match(r"(http|ws)://127\.0\.0\.1:\d+/|data:|file:", url)]


def test_a_walk_is_drawn_as_it_happens(chromium: Chromium, play: Callable[..., str]) -> None:
    page = chromium.open(play("--stones", "40"))
    page.wait(DRAWN)
    assert page.look("document.querySelectorAll('#scenes canvas').length") == 2
    assert colours(page) > 20
    row = page.look("rabbit.clock.row")
    page.wait(f"rabbit.clock.row > {row} + 20")
    hip, stones = page.look("(w => [w.get(rabbit.clock.row, 'hip_z'), w.stones.length])(rabbit.state.walk.walkers[0])")
    assert 0.6 < hip < 0.9
    assert stones >= 2
    plots = page.look("[...rabbit.plots.plots].map(({plot}) => plot.data[0].length)")
    assert len(plots) == 7
    assert min(plots) > 10
    check_requests(page)


def test_a_first_visit_sees_the_walk_the_fall_and_why(chromium: Chromium, play: Callable[..., str]) -> None:
    """However late it comes; and who comes later still sees the same, and not its end."""
    address = play()
    time.sleep(3)
    page = chromium.open(address)
    page.wait("rabbit.state.pictures")
    assert page.look("rabbit.state.walk.length") == 1
    assert page.look("document.querySelector('#sentence').textContent").startswith("Both robots weigh half of what")
    page.wait("rabbit.clock.row > 50")
    walk = "rabbit.state.walk.walkers[1]"
    page.wait(f"{walk}.fall && rabbit.clock.row >= {walk}.fall.from && rabbit.clock.pace() < 1")
    page.wait("rabbit.state.ended[1]?.outcome === 'fall' && !document.querySelector('#happened.waits')")
    said = page.look("document.querySelector('#happened').textContent")
    assert said == page.look("rabbit.state.ended[1].reason")
    assert said.startswith("tuned fell after 8 stones. It could not keep the row")
    page.click("#things button")
    page.wait("!document.querySelector('#why').hidden")
    assert page.look("document.querySelector('#happened').textContent") == said
    row = r"CLF was kept in the model.*promised (\S+), measured (\S+),"
    ((promised, measured),) = re.findall(row, page.look(WHY))
    assert f"fall by {promised.lstrip('-')} " in said
    assert f"rose by {measured}, " in said
    assert page.look("document.querySelector('#why').getBoundingClientRect().bottom <= innerHeight")
    page.press("Escape")
    assert page.look("document.querySelector('#why').hidden")
    lying = f"{walk}.get({walk}.fall.to, 'hip_z') - {walk}.get({walk}.fall.to, 'stone_top')"
    assert page.look(lying) < 0.35
    page.wait("rabbit.state.ended[0]?.outcome === 'walked'")
    late = chromium.open(address)
    late.wait("rabbit.state.pictures")
    late.wait(f"rabbit.clock.row > 0 && rabbit.clock.row < {walk}.fall.from")
    assert late.look("document.querySelector('#happened').className") == "waits"
    late.wait("!document.querySelector('#happened.waits')")
    for opened in (page, late):
        check_requests(opened)


def test_every_button_does_what_it_says(chromium: Chromium, play: Callable[..., str]) -> None:
    page = chromium.open(play("--stones", "40"))
    page.wait(DRAWN)
    page.click("#pause")
    page.wait("rabbit.controls.state.paused")
    held = page.look("rabbit.state.walk.length")
    page.click("#tick")
    page.wait(f"rabbit.state.walk.length === {held + 1}")
    page.drag("#force", 0.9)
    force = page.look("rabbit.controls.force")
    assert force > 400
    page.click("#push-on")
    page.click("#push-back")
    page.click("#pause")
    page.wait("!rabbit.controls.state.paused")
    page.wait("rabbit.state.walk.walkers[0].marks.some(({kind}) => kind === 'pushed')")
    page.drag("#speed", 0.3)
    page.wait("rabbit.controls.state.speed < 0.8")
    page.click("#reset")
    page.wait("rabbit.state.walk.walkers[0].marks.every(({kind}) => kind !== 'pushed')")
    seed = page.look("rabbit.controls.state.settings.seed")
    page.click("#next")
    page.wait(f"rabbit.state.walk.about.title === 'course {seed + 1}'")
    page.click("#link")
    page.wait("!document.querySelector('#notice').hidden")
    theme = page.look("document.documentElement.dataset.theme")
    page.click("#theme")
    assert page.look("document.documentElement.dataset.theme") != theme
    page.click("#help")
    page.wait("document.querySelector('#keys').open")
    page.click("#keys button")
    page.wait("!document.querySelector('#keys').open")
    page.click("#which button:nth-child(2)")
    page.wait("rabbit.plots.chosen === 1")
    page.choose("#quantity", "2")
    page.wait("rabbit.plots.plots.at(-1).columns[0] === 'measured_B2'")
    unclicked = "[...document.querySelectorAll('button, a')].map((each) => each.id || each.textContent)"
    assert set(page.look(unclicked)) == {
        *("pause", "tick", "reset", "next", "push-back", "push-on", "link", "save", "theme", "help", "live", "Close"),
        *("plots: best", "plots: tuned", "Why did it fall?", "3 times the mass", "Push them", "✕"),
    }
    check_requests(page)


def test_a_saved_walk_opens_from_disk_without_a_network(chromium: Chromium, tmp_path: Path) -> None:
    path = tmp_path / "walk.html"
    subprocess.run([*RABBIT, "play", "--stones", "6", "--export", str(path)], check=True, timeout=300)
    page = chromium.open(f"file://{path}", offline=True)
    page.wait("rabbit.state.pictures > 5")
    assert colours(page) > 20
    page.click("#play")
    page.wait("!rabbit.clock.isPlaying")
    page.drag("#time", 0.5)
    row, length = page.look("[rabbit.clock.row, rabbit.state.walk.length]")
    assert row == pytest.approx(length / 2, abs=0.02 * length)
    page.click("#on")
    page.wait(f"rabbit.clock.row === {row + 1}")
    page.click("#back")
    page.wait(f"rabbit.clock.row === {row}")
    page.choose("#rate", "4")
    page.click("#play")
    page.wait("rabbit.clock.row === rabbit.state.walk.length - 1 && !rabbit.clock.isPlaying")
    marks = page.look("rabbit.state.walk.walkers[0].marks.filter(({kind}) => kind === 'stone').length")
    assert marks == page.look("rabbit.state.ended[0].stones") - 1 or marks == 6
    assert page.look("document.querySelector('#controls').hidden")
    check_requests(page)


CART_POLE = str(Path(__file__).resolve().parents[2] / "examples" / "cart_pole.py")


def test_a_task_rides_and_a_person_changes_it(chromium: Chromium, play: Callable[..., str]) -> None:
    page = chromium.open(play("--task", CART_POLE))
    page.wait("rabbit.clock.row > 30 && rabbit.controls.state")
    assert min(colours(page, index, below=60) for index in (0, 1)) > 3
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
