"""`rabbit play` as a process: the walk that its browsers see, whatever they send, and how it ends."""

import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from page_client import PageClient

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")
ALONE = ("--second", "none", "--stones", "4", "--seed", "2")
ENDING_SECONDS = 30  # generous: 2 s is the bar, on a machine with nothing else to do


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
        (
            ("--terrain", "flat", "--first", "learned", "--export", "/nowhere/walk.html"),
            "rabbit: --terrain flat: expected stones",
        ),
        (("--policy", "nowhere"), "rabbit: --policy nowhere: expected one of zero, oracle"),
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
