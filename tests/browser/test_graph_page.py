"""A running graph on the page, and what it lets a browser ask."""

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import Chromium
from rabbit_command import RABBIT
from served import Served

NAMESPACE = "page_test"
WALK = ("--no-pictures", "--no-video", "--no-trainer", "--no-record", "--episodes", "50", "--pace", "1")


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[None]:
    """Walks at the pace of real time."""
    command = [*RABBIT, "walk", "--out", str(tmp_path / "walk"), "--namespace", NAMESPACE, *WALK]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    yield
    process.terminate()
    process.wait(timeout=180)


@pytest.mark.parametrize("control", [True, False])
def test_a_graph_is_seen_and_obeys_where_it_is_allowed(chromium: Chromium, graph: None, control: bool) -> None:
    view = Served("view", "--namespace", NAMESPACE, *(["--control"] if control else []))
    try:
        page = chromium.open(view.address)
        page.wait("rabbit.state.pictures > 20 && rabbit.state.walk.walkers[0].about.R1 === 1")
        hip = page.look("(w => w.get(rabbit.clock.row, 'hip_z'))(rabbit.state.walk.walkers[0])")
        assert 0.6 < hip < 0.9
        if not control:
            page.look("rabbit.source.send({do: 'pause', paused: true})")
            page.wait("rabbit.state.words.refused?.text.includes('--control')")
            assert page.look("document.querySelector('#controls').hidden")
        else:
            page.click("#pause")
            page.wait("rabbit.state.words.graph.phase === 'paused'")
            page.click("#pause")
            page.wait("rabbit.state.words.graph.phase === 'running'")
            page.look("document.querySelector('#seed').value = 77")
            page.click("#reset")
            page.wait("rabbit.state.walk.about.title.endsWith('seed 77')")
            page.look("document.querySelector('#policy').value = '/nowhere'")
            page.click("#load")
            page.wait("rabbit.state.words.note?.text.startsWith('load_policy: refused')")
        assert page.errors == []
        assert not [url for url in page.requests if not re.match(r"(http|ws)://127\.0\.0\.1:\d+/|data:", url)]
    finally:
        assert view.end() == 0
