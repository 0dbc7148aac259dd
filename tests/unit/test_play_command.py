"""`rabbit play` as a process: the walk that its browsers see, whatever they send, and how it ends."""

import asyncio
import json
import os
import random
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from typing import Any

import pytest
from page_client import PageClient
from rabbit_viewer.play.settings import CONTROLLERS, PlaySettings
from websockets.asyncio.client import connect

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")
ALONE = ("--second", "none", "--stones", "4", "--seed", "2")
BAD = (
    "",
    "{",
    "[]",
    "null",
    '{"do": "fly"}',
    '{"do": "push", "force": 1e999}',
    '{"do": "set", "settings": 7}',
    "\0" * 50,
)
FLOOD = 5_000
CROWD = 20  # browsers
CROWD_SECONDS = float(os.environ.get("RABBIT_CROWD_SECONDS", "6"))  # the bar is 600
MESSAGE_SECONDS = 0.021  # of a browser: its limit is 50 in a second
ENDING_SECONDS = 30  # generous: 2 s is the bar, on a machine with nothing else to do
DESCRIPTORS = 64
HANDSHAKE = (
    "GET /walk HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


class Play:
    """The command, its address."""

    def __init__(self, *words: str, prepare: Any = None) -> None:
        command = [*RABBIT, "play", "--no-browser", "--port", "0", *words]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=prepare
        )
        assert self.process.stdout
        self.address = re.findall(r"http://[\d.:]+", self.process.stdout.readline())[0]

    def end(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """By a signal; the exit code and what it said on stderr."""
        self.process.send_signal(number)
        _, errors = self.process.communicate(timeout=ENDING_SECONDS)
        return self.process.returncode, errors


@pytest.fixture
def started() -> Iterator[Callable[..., Play]]:
    """Starts the command; kills what has not ended by the test's end."""
    plays: list[Play] = []

    def start(*words: str, **options: Any) -> Play:
        plays.append(Play(*words, **options))
        return plays[-1]

    yield start
    for play in plays:
        play.process.kill()
        play.process.wait()


@pytest.fixture
def play(started: Callable[..., Play]) -> Play:
    """One robot, four stones."""
    return started(*ALONE)


def ended(client: PageClient) -> bool:
    """The walk is over, and all of it has come."""
    return "ended" in client.words and bool(client.rows) and client.rows[-1][0]["running"] == 0


def test_a_flood_of_bad_messages_changes_nothing(play: Play) -> None:
    rng = random.Random(3)
    with PageClient(play.address) as bad, PageClient(play.address) as other:
        for _ in range(FLOOD):
            bad.say(rng.choice(BAD))
        bad.wait(lambda client: sum(word["type"] == "refused" for word in client.said) == FLOOD)
        other.say({"do": "reset"})
        other.wait(lambda client: sum(word["type"] == "about" for word in client.said) == 2)
        other.wait(ended)
        bad.wait(ended)
        assert str(bad.rows) == str(other.rows)  # some are NaN
        assert other.words["ended"]["walkers"] == [{"outcome": "walked", "stones": 4}]
        assert "refused" not in other.words
        with PageClient(play.address) as late:
            late.wait(ended)
            assert str(late.rows) == str(other.rows)
    assert play.end() == (0, "")


def test_a_browsers_wish_is_done(play: Play) -> None:
    with PageClient(play.address) as client:
        client.wait(lambda client: "state" in client.words)
        client.say({"do": "pause", "paused": True})
        client.wait(lambda client: client.words["state"]["paused"])
        settings = client.words["state"]["settings"]
        client.say({"do": "begin", "settings": {**settings, "mass_scale": 1.0, "second": "nominal"}})
        client.wait(lambda client: len(client.words["about"]["walkers"]) == 2)
        assert [walker["mass_scale"] for walker in client.words["about"]["walkers"]] == [1.0, 1.0]
    assert play.end() == (0, "")


def test_what_is_learned_next_to_the_walk_walks_at_once(started: Callable[..., Play]) -> None:
    play = started("--learn", "--second", "none", "--stones", "4", "--seed", "2")
    with PageClient(play.address) as client:
        client.wait(lambda client: any(word["type"] == "swap" for word in client.said))
        (first, *_) = client.words["learning"]["episodes"]
        assert (first["episode"], set(first["reward"])) == (0, {"V", "B1", "B2", "C1", "C2", "failure"})
        assert client.words["about"]["learns"]
        swapped = client.words["swap"]["version"]
        assert swapped not in ("zero", "rl-cbf-clf-qp")
    assert play.end() == (0, "")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--mass-scale", "9"), "rabbit: --mass-scale 9"),
        (("--first", "nobody"), "rabbit: --first nobody: expected"),
        (("--terrain", "flat", "--first", "learned"), "rabbit: --terrain flat: expected stones"),
        (
            ("--terrain", "flat", "--first", "learned", "--export", "/nowhere/walk.html"),
            "rabbit: --terrain flat: expected stones",
        ),
        (("--first", "yours"), "rabbit: controller yours: expected --controller, --policy or --parameters"),
        (("--second", "recording"), "rabbit: on the same course recording: expected --recording RUN"),
        (("--policy", "nowhere"), "rabbit: --policy nowhere: expected one of zero, oracle"),
        (("--recording", "/nowhere"), "rabbit: "),
        (("--gait", "nowhere"), "rabbit: gait nowhere: no such file, expected one of "),
        (("--export", "/nowhere/walk.html", *ALONE), "rabbit: --export /nowhere/walk.html: No such file"),
    ],
)
def test_bad_values_are_one_line(words: tuple[str, ...], line: str) -> None:
    done = subprocess.run(
        [*RABBIT, "play", "--no-browser", "--port", "0", *words],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith(line)
    assert done.stderr.count("\n") == 1


def test_a_taken_port_is_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        command = [*RABBIT, "play", "--no-browser", "--port", str(taken.getsockname()[1])]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "Address already in use" in done.stderr


class Browser:
    """Sends at its limit what a page can ask, and reads. `ticks`: shown; `longest`: s without one."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        self.ticks = self.walks = self.refused = 0
        self.heard = self.longest = 0.0

    async def run(self, address: str, until: float) -> None:
        """Until that time of the event loop's clock."""
        async with connect(f"{address.replace('http', 'ws', 1)}/walk", max_size=None) as connection:
            reading = asyncio.create_task(self._read(connection))
            while asyncio.get_running_loop().time() < until:
                await connection.send(json.dumps(self._wish()))
                await asyncio.sleep(MESSAGE_SECONDS)
            reading.cancel()

    def _wish(self) -> dict[str, Any]:
        settings = {"again": "same course", "seed": 2, "stones": 200, "payload": self._rng.randrange(30)}
        loaded = PlaySettings.model_validate(settings).model_dump(mode="json")
        often: list[dict[str, Any]] = [
            {"do": "set", "settings": loaded},
            {"do": "push", "force": self._rng.uniform(-50, 50)},
            {"do": "speed", "speed": 1},
            {"do": "pause", "paused": False},
        ]
        other = {**loaded, "first": self._rng.choice(list(CONTROLLERS))}
        seldom: list[dict[str, Any]] = [
            {"do": "set", "settings": other},
            {"do": "begin", "settings": other},
            {"do": "reset"},
            {"do": "tick"},
        ]
        return self._rng.choice(seldom if self._rng.random() < 0.0001 else often)

    async def _read(self, connection: Any) -> None:
        numbers = 0
        async for message in connection:
            if isinstance(message, str):
                word = json.loads(message)
                self.refused += word["type"] == "refused"
                if word["type"] == "about":
                    self.walks += 1
                    numbers = sum(len(walker["columns"]) for walker in word["walkers"])
                continue
            now = time.monotonic()
            self.longest = max(self.longest, now - self.heard) if self.heard else 0.0
            self.heard = now
            self.ticks += len(message) // 4 // numbers


def test_a_crowd_at_its_limit_does_not_stop_the_walk(started: Callable[..., Play]) -> None:
    play = started("--stones", "200", "--seed", "2")
    browsers = [Browser(seed) for seed in range(CROWD)]
    with PageClient(play.address) as client:
        client.wait(lambda client: client.rows)

    async def crowd() -> None:
        until = asyncio.get_running_loop().time() + CROWD_SECONDS
        await asyncio.gather(*(browser.run(play.address, until) for browser in browsers))

    asyncio.run(crowd())
    with PageClient(play.address) as client:
        client.say({"do": "pause", "paused": False})
        client.wait(lambda client: client.rows)
        known = len(client.rows)
        client.wait(lambda client: len(client.rows) > known)
    began = time.monotonic()
    assert play.end(signal.SIGTERM) == (0, "")
    one = browsers[0]
    print(
        f"{CROWD} browsers, {CROWD_SECONDS:g} s: {one.ticks} ticks of {one.walks} walks, at most {one.longest:.2f} s "
        f"without one, {one.refused} messages of a browser refused, ended in {time.monotonic() - began:.2f} s"
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_browsers_that_read_nothing_do_not_hold_up_the_end(play: Play, number: int) -> None:
    host, port = play.address.removeprefix("http://").split(":")
    with ExitStack() as stack:
        for _ in range(3):
            silent = stack.enter_context(socket.create_connection((host, int(port))))
            silent.sendall(HANDSHAKE.format(host=f"{host}:{port}").encode())
        stack.enter_context(socket.create_connection((host, int(port))))  # asks for nothing
        with PageClient(play.address) as client:
            client.wait(lambda client: client.rows)
        play.process.send_signal(number)
        _, errors = play.process.communicate(timeout=8)  # without a limit of ours it takes 10 s
    assert (play.process.returncode, errors) == (0, "")


def test_a_flood_of_connections_is_one_line(started: Callable[..., Play]) -> None:
    """Where a process has few descriptors; afterwards the page is there again."""
    few = partial(resource.setrlimit, resource.RLIMIT_NOFILE, (DESCRIPTORS, DESCRIPTORS))
    play = started(*ALONE, prepare=few)
    host, port = play.address.removeprefix("http://").split(":")
    with ExitStack() as stack:
        for _ in range(2 * DESCRIPTORS):
            stack.enter_context(socket.create_connection((host, int(port))))
        time.sleep(3)  # for what it would write
    with PageClient(play.address) as client:
        client.wait(lambda client: client.rows)
    code, errors = play.end()
    assert code == 0
    assert re.fullmatch(r"(page: [^\n]*Too many open files[^\n]*\n){1,3}", errors)  # one in 10 s
