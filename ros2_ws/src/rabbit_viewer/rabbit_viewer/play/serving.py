"""The processes of `rabbit play`, and the page between them and the browsers."""

import asyncio
import json
from collections.abc import Callable
from contextlib import AsyncExitStack
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError
from rabbit_common.options import fault

from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.export import write_page
from rabbit_viewer.page.server import refused, serve_until
from rabbit_viewer.play.channel import ServerChannel, process
from rabbit_viewer.play.learning import learn
from rabbit_viewer.play.messages import ASKED, LOAD, Begin, PushNow, Set
from rabbit_viewer.play.settings import Start, plant_of

BUSY = "the walk has not yet done what was asked before: ask again"
SHOWN = ("episode", "steps", "ticks", "reward", "losses")  # of an episode's report
KEPT_EPISODES = 20


class PlayError(ValueError):
    """What is given cannot walk."""


class Door:
    """Checks what browsers ask of a walk, and hands it to `ask`, which says why it is refused, or nothing."""

    def __init__(self, start: Start, ask: Callable[[bytes], str]) -> None:
        self._start, self._ask = start, ask

    def __call__(self, message: str) -> str:
        """Empty, or why the message is refused."""
        try:
            asked = ASKED.validate_json(message)
            if isinstance(asked, Set | Begin):
                settings = asked.settings if isinstance(asked, Set) else asked.script.settings
                changes = asked.script.changes if isinstance(asked, Begin) else ()
                for changed in ({}, *({change.name: change.value} for change in changes)):
                    plant_of(self._start.plant, settings.model_copy(update=changed))
        except ValidationError as error:
            return refused(fault(error))
        pushes = isinstance(asked, PushNow) or (isinstance(asked, Begin) and asked.script.pushes)
        if pushes and self._start.plant.plant == "rigid":
            return "push: expected the plant pybullet or mujoco"
        return self._ask(asked.model_dump_json().encode())


async def serve_play(start: Start, port: int, opens_browser: bool) -> None:
    """Play and serve until Ctrl-C, or until the player has ended.

    Raises:
        PageError: the port is taken.
        PlayError: what is given cannot walk.
    """
    ended, broadcast = asyncio.Event(), Broadcast()
    errors: list[str] = []

    def take(message: bytes) -> None:
        if message[:1] == b"E":
            errors.append(message[1:].decode())
        else:
            tell(broadcast, message)

    async with AsyncExitStack() as stack:
        player = await stack.enter_async_context(process(play, start, take=take, end=ended.set))
        if start.learns:
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="rabbit_play_")))
            lessons = Lessons(broadcast, player.send)
            learner = process(learn, start, folder, take=lessons.take, end=lessons.end)
            await stack.enter_async_context(learner)
        await serve_until(ended, broadcast, Door(start, partial(pass_on, player)), port, opens_browser)
    if errors:
        raise PlayError(errors[0])


def pass_on(player: ServerChannel, message: bytes) -> str:
    """Ask the player; a line where it is too busy to be asked."""
    if player.is_full:
        return BUSY
    player.send(message)
    return ""


class Lessons:
    """Shows the training's episodes on the page, and hands each policy to the player."""

    def __init__(self, broadcast: Broadcast, send: Callable[[bytes], None]) -> None:
        self._broadcast, self._send = broadcast, send
        self._episodes: list[dict[str, Any]] = []
        self._say("the first episode begins")

    def take(self, message: bytes) -> None:
        """An episode's report."""
        report = json.loads(message)
        self._episodes.append({name: report[name] for name in SHOWN})
        self._say(f"{len(self._episodes)} of {report['of']} episodes")
        self._send(LOAD + report["policy"].encode())

    def end(self) -> None:
        """The training is over."""
        self._say(f"ended after {len(self._episodes)} episodes")

    def _say(self, text: str) -> None:
        self._broadcast.say("learning", {"text": text, "episodes": self._episodes[-KEPT_EPISODES:]})


def play(channel: Connection, start: Start) -> None:
    """The player's process, which alone imports the engines."""
    from rabbit_viewer.play.player import play

    play(channel, start)


def tell(broadcast: Broadcast, message: bytes) -> None:
    """Tell what a message of the player says, see `player`."""
    kind, rest = message[:1], message[1:]
    if kind == b"R":
        broadcast.add(rest)
    elif kind == b"A":
        broadcast.begin(json.loads(rest))
    else:
        broadcast.say(*json.loads(rest))


def write_play(start: Start, path: Path) -> Path:
    """Walk one episode as fast as it goes, and write it; raises `PageError`."""
    from rabbit_viewer.play.player import Player

    broadcast = Broadcast()
    player = Player(start, partial(tell, broadcast))
    while not player.has_ended:
        player.tick()
    player.flush()
    player.close()
    return write_page(path, broadcast)
