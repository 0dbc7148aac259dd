"""Every link of the site, followed in a browser: it opens a page there, or a file that is no page."""

import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.request import Request, urlopen

import pytest
from chromium import Chromium

SITE = Path(__file__).resolve().parents[2] / "docs" / "build"
LINKS = "[...document.links].map((each) => each.href)"
ANCHORS = "[...document.querySelectorAll('[id], a[name]')].map((each) => each.id || each.name)"
ICON = "document.querySelector('link[rel~=icon]').href"


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Of a web server that knows nothing but the site's files."""
    if not (SITE / "README.html").is_file():
        pytest.skip("no site here: make docs")

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(SITE))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def status(address: str) -> int:
    """Of the server's answer."""
    with urlopen(Request(address, method="HEAD")) as answer:
        return int(answer.status)


@pytest.mark.timeout(1200)
def test_every_link_opens_a_page_or_a_file(chromium: Chromium, address: str) -> None:
    page = chromium.open(address)
    page.wait("document.readyState === 'complete'")
    first = f"{address}index.html"  # which goes on to README.html, or walks (test_walk_in_browser.py)
    todo, links, icons, anchors = [f"{address}README.html"], {first}, set[str](), dict[str, set[str]]()
    while todo:
        at = todo.pop()
        if at in anchors:
            continue
        page.call("Page.navigate", url=at)
        page.wait(f"location.href === '{at}' && document.readyState === 'complete'")
        assert page.look("document.contentType") == "text/html", at
        icons.add(page.look(ICON))
        anchors[at] = {"", *page.look(ANCHORS)}
        here = {each for each in page.look(LINKS) if each.startswith(address)}
        links |= here
        todo += [each for each in (each.partition("#")[0] for each in here) if each.endswith(".html") and each != first]
    files = {each.partition("#")[0] for each in links} - anchors.keys()
    assert not [each for each in files - {first} if each.endswith((".md", ".html"))]
    for each in sorted(files | icons):
        assert each.startswith("data:") or status(each) == 200, each
    dead = [
        each for each in links if (parts := each.partition("#"))[0] in anchors and parts[2] not in anchors[parts[0]]
    ]
    assert not dead
    assert len(anchors) > 80
    print(f"{len(links)} links, {len(anchors)} pages, {len(files)} files")
