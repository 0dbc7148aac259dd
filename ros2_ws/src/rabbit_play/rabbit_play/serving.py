"""The processes of `rabbit play`, and the page between them and the browsers."""

import asyncio
import json
import multiprocessing
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError
from rabbit_cli.options import fault
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.export import write_page
from rabbit_viewer.page.server import refused, serve_until

from rabbit_play.learning import learn
from rabbit_play.messages import ASKED, LOAD, Begin, PushNow, Set
from rabbit_play.settings import Start, plant_of

ENDING_SECONDS = 2.0
SHOWN = ("episode", "steps", "ticks", "reward", "losses")  # of an episode's report
KEPT_EPISODES = 20


class PlayError(ValueError):
    """What is given cannot walk."""


class Door:
    """Checks what browsers ask of a walk, and passes it on."""

    def __init__(self, start: Start, send: Callable[[bytes], None]) -> None:
        self._start, self._send = start, send

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
        self._send(asked.model_dump_json().encode())
        return ""


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

    with ExitStack() as stack:
        player = stack.enter_context(process(play, start))
        hear(player, take, ended.set)
        if start.learns:
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="rabbit_play_")))
            lessons = Lessons(broadcast, player.send_bytes)
            hear(stack.enter_context(process(learn, start, folder)), lessons.take, lessons.end)
        await serve_until(ended, broadcast, Door(start, player.send_bytes), port, opens_browser)
    if errors:
        raise PlayError(errors[0])


@contextmanager
def process(target: Callable[..., None], *arguments: Any) -> Iterator[Connection]:
    """A process that calls `target(connection, *arguments)`; this end of the connection."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    started = context.Process(target=until_closed, args=(target, there, *arguments), daemon=True)
    started.start()
    there.close()
    try:
        yield here
    finally:
        asyncio.get_running_loop().remove_reader(here.fileno())
        here.close()
        started.join(timeout=ENDING_SECONDS)
        started.terminate()


def until_closed(target: Callable[..., None], *arguments: Any) -> None:
    """A process ends when its connection does; a Ctrl-C at the terminal is for the one that serves."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, ConnectionError):
        target(*arguments)


def hear(connection: Connection, take: Callable[[bytes], object], end: Callable[[], object]) -> None:
    """Call `take` with each message from now on, `end` when there will be no more."""

    def on_message() -> None:
        try:
            while connection.poll():
                take(connection.recv_bytes())
        except (EOFError, ConnectionResetError):
            asyncio.get_running_loop().remove_reader(connection.fileno())
            end()

    asyncio.get_running_loop().add_reader(connection.fileno(), on_message)


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


def play(connection: Connection, start: Start) -> None:
    """The player's process, which alone imports the engines."""
    from rabbit_play.player import play

    play(connection, start)


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
    from rabbit_play.player import Player

    broadcast = Broadcast()
    player = Player(start, partial(tell, broadcast))
    while not player.has_ended:
        player.tick()
    player.close()
    return write_page(path, broadcast)
