"""The page where the robot walks in the browser itself: from a plain web server, then without any network."""

import gzip
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from built_walk_page import build
from chromium import Chromium

WALKS = "rabbit.state.pictures > 5 && rabbit.controls.state"
MOST_BYTES = 5_000_000  # of all that the page asks for, compressed
SECONDS = 4


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that is served."""
    return build(tmp_path_factory.mktemp("site"))


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """Of a web server that knows nothing but files."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def test_it_walks_without_a_network(chromium: Chromium, site: Path, address: str) -> None:
    page = chromium.open(address)
    page.wait("rabbit.state.pictures > 0")
    first = page.look("performance.now()")  # since it was asked for
    page.wait(WALKS)
    page.go_offline()
    asked = len(page.requests)
    script = "[performance.now(), rabbit.state.pictures, rabbit.source.player.ticks]"
    start = page.look(script)
    page.wait(f"rabbit.source.player.ticks >= {start[2]} + {100 * SECONDS}")
    end = page.look(script)
    page.wait("rabbit.state.walk.walkers.every((each) => each.touchdowns >= 3)")
    assert page.errors == []
    assert len(page.requests) == asked, "it asked for something without a network"
    assert not [url for url in page.requests if not url.startswith((address, "data:", "blob:"))]
    files = {url.removeprefix(address).partition("#")[0] or "index.html" for url in page.requests if "http" in url}
    size = sum(len(gzip.compress((site / name).read_bytes())) for name in files)
    assert size < MOST_BYTES
    seconds = (end[0] - start[0]) / 1000
    print(
        f"first picture {first / 1000:.2f} s, {(end[2] - start[2]) / 100 / seconds:.3f} times real time, "
        f"{(end[1] - start[1]) / seconds:.0f} pictures a second, {size / 1e6:.2f} MB in {len(files)} files"
    )


def test_what_is_changed_acts(chromium: Chromium, address: str) -> None:
    page = chromium.open(address)
    page.wait(WALKS)
    robots, now = "rabbit.source.player.robots", "rabbit.controls.state.settings"
    page.drag("#mass_scale", 0.4)
    page.wait(f"{now}.mass_scale < 1.9 && {robots}.every((r) => r.episode.plant.settings.mass_scale < 1.9)")
    page.drag("#first_eps", 0.5)
    page.wait(f"{now}.first_eps > 0.05 && {robots}[0].controller.eps === {now}.first_eps")
    page.drag("#stone_width", 0.6)
    last = f"{robots}[0].episode.terrain.placed.at(-1)"
    page.wait(f"{now}.stone_width > 0.1 && Math.abs({last}[1] - {last}[0] - {now}.stone_width) < 1e-9")
    page.click("#push-on")
    page.wait("rabbit.state.walk.walkers[0].marks.some(({kind}) => kind === 'pushed')")
    assert "kg" in page.look("document.getElementById('truth').textContent")
    page.choose("#second", "none")
    page.click("#reset")
    page.wait("rabbit.state.walk.walkers.length === 1")
    assert page.errors == []
