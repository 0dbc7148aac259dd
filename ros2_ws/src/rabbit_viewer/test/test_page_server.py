"""The page over HTTP and its websocket: the same for all who come, only from this machine, and in one file."""

import base64
import gzip
import json
import re
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from http.client import HTTPConnection
from pathlib import Path

import pytest
from page_client import PageClient
from rabbit_viewer.page import PageError
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.files import contents, page_with, write_page
from rabbit_viewer.page.server import MOST_MESSAGES, PageServer
from websockets.exceptions import InvalidStatus

WALKER = {"name": "nominal", "columns": ["tick", "V"], "quantities": []}
ABOUT = {"mode": "play", "title": "</script><b>", "tick_seconds": 0.01, "walkers": [WALKER]}


def rows(first: int, count: int) -> bytes:
    """Ticks from `first` on, V half of them."""
    return b"".join(struct.pack("<2f", tick, tick / 2) for tick in range(first, first + count))


@pytest.fixture
def broadcast() -> Broadcast:
    """A walk that has begun."""
    begun = Broadcast()
    begun.begin(ABOUT)
    return begun


@pytest.fixture
def page(broadcast: Broadcast) -> Iterator[PageServer]:
    """Answers each message with itself as the refusal, if it is a word."""
    served = PageServer(broadcast, lambda message: message if message.isalpha() else "", 0)
    yield served
    served.close()


def get(address: str, path: str, **headers: str) -> tuple[int, str]:
    """Status and body."""
    connection = HTTPConnection(address.removeprefix("http://"), timeout=60)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode(errors="replace")


def test_all_files_that_the_page_names_are_served(page: PageServer) -> None:
    status, index = get(page.address, "/")
    assert status == 200
    named = re.findall(r'(?:href|src)="([^"]+?\.(?:css|js|html))"', index) + re.findall(r'"\./(\w+\.js)"', index)
    assert len(named) > 10
    for path in named:
        assert get(page.address, f"/{path}")[0] == 200, path
    scripts = "".join(body.decode() for name, (_, body) in contents().items() if re.fullmatch(r"\w+\.js", name))
    imported = set(re.findall(r'from "(\w+)"', scripts))
    assert imported <= set(re.findall(r'"(\w+)": "\./', index))


@pytest.mark.parametrize("path", ["/../server.py", "/uplot/../../server.py", "/static", "/nowhere", "/%2e%2e/x"])
def test_nothing_else_is_served(page: PageServer, path: str) -> None:
    assert get(page.address, path)[0] == 404


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example"}, {"Host": "evil.example:80"}, {"Host": ""}, {"Origin": "http://evil.example"}]
    + [{"Origin": "null"}, {"Origin": "http://127.0.0.1:1"}],
)
def test_another_sites_page_gets_nothing(page: PageServer, headers: dict[str, str]) -> None:
    assert get(page.address, "/", **headers)[0] == 403
    if "Origin" in headers:
        with pytest.raises(InvalidStatus, match="403"), PageClient(page.address, timeout=5, **headers):
            pass


def test_two_browsers_and_a_late_third_see_the_same(page: PageServer, broadcast: Broadcast) -> None:
    with PageClient(page.address) as one, PageClient(page.address) as two:
        for first in range(0, 50, 10):
            broadcast.add(rows(first, 10))
        for client in (one, two):
            client.wait(lambda client: len(client.rows) == 50)
        broadcast.say("state", {"paused": True})
        with PageClient(page.address) as three:
            three.wait(lambda client: len(client.rows) == 50 and "state" in client.words)
            assert three.rows == one.rows == two.rows
        assert one.rows[7] == [{"tick": 7.0, "V": 3.5}]
        broadcast.begin({**ABOUT, "title": "next"})
        broadcast.add(rows(0, 3))
        two.wait(lambda client: client.words["about"]["title"] == "next" and len(client.rows) == 3)


def test_too_many_messages_are_refused(page: PageServer) -> None:
    with PageClient(page.address) as one:
        for _ in range(5 * MOST_MESSAGES):
            one.say("1")
        one.wait(lambda client: "refused" in client.words)
        assert f"more than {MOST_MESSAGES} messages" in one.words["refused"]["text"]


def test_a_taken_port_is_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(PageError, match=rf"^page at 127.0.0.1:{port}: Address already in use; expected [^\n]*$"):
            PageServer(Broadcast(), str, port)


def test_slow_readers_do_not_hold_up_the_end(page: PageServer, broadcast: Broadcast) -> None:
    with ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(PageClient(page.address))
        broadcast.add(rows(0, 2_000_000))  # 16 MB, more than sockets hold
        while not page.is_watched:
            pass
        closing = threading.Thread(target=page.close, daemon=True)
        closing.start()
        closing.join(timeout=8)  # without a limit of ours it takes 10 s
        assert not closing.is_alive()


def test_a_saved_page_holds_the_walk_and_asks_nobody(page: PageServer, broadcast: Broadcast, tmp_path: Path) -> None:
    broadcast.add(rows(0, 20))
    with PageClient(page.address) as one:
        one.wait(lambda client: len(client.rows) == 20)
    status, served = get(page.address, "/walk.html")
    assert status == 200
    text = write_page(tmp_path / "walk.html", broadcast).read_text(encoding="utf-8")
    assert text == served == page_with(broadcast)
    inside = json.loads(re.findall(r'id="walk-data">(.*?)</script>', text, re.DOTALL)[0])
    assert inside["words"] == [{"type": "about", **ABOUT}]
    assert gzip.decompress(base64.b64decode(inside["rows"])) == rows(0, 20)
    assert not re.findall(r'(?:src|href)="(?!data:|walk\.html)', text)
    assert "default-src 'none'" in text
    with pytest.raises(PageError, match=r"^--export /nowhere/walk\.html: No such file"):
        write_page(Path("/nowhere/walk.html"), broadcast)
