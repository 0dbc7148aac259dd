"""`rabbit play` as a process: what a browser wishes is done, and what is learned beside the walk walks."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from page_client import PageClient
from served import Served

ALONE = ("--second", "none", "--stones", "4", "--seed", "2")


@pytest.fixture
def client() -> Iterator[Callable[..., PageClient]]:
    """Plays under these options and looks; the command ends well."""
    with ExitStack() as stack:
        yield lambda *words: PageClient(stack.enter_context(Served("play", *ALONE, *words)).address)


def test_a_browsers_wish_is_done(client: Callable[..., PageClient]) -> None:
    with client() as seen:
        seen.wait(lambda seen: "state" in seen.words)
        seen.say({"do": "pause", "paused": True})
        seen.wait(lambda seen: seen.words["state"]["paused"])
        settings = seen.words["state"]["settings"]
        seen.say({"do": "begin", "settings": {**settings, "mass_scale": 1.0, "second": "nominal"}})
        seen.wait(lambda seen: len(seen.words["about"]["walkers"]) == 2)
        assert [walker["mass_scale"] for walker in seen.words["about"]["walkers"]] == [1.0, 1.0]


def test_what_is_learned_next_to_the_walk_walks_at_once(client: Callable[..., PageClient]) -> None:
    with client("--learn") as seen:
        seen.wait(lambda seen: any(word["type"] == "swap" for word in seen.said))
        (first, *_) = seen.words["learning"]["episodes"]
        assert (first["episode"], set(first["reward"])) == (0, {"V", "B1", "B2", "C1", "C2", "failure"})
        assert seen.words["about"]["learns"]
        assert seen.words["swap"]["version"] not in ("zero", "rl-cbf-clf-qp")
