"""The processes of `rabbit play`, and the page between them and the browsers."""

import asyncio
import json
import multiprocessing
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from rabbit_cli.options import fault
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.export import write_page
from rabbit_viewer.page.server import refused, serve_until

from rabbit_play.messages import ASKED, PushNow, Set
from rabbit_play.settings import Start, plant_of


class Door:
    """Checks what browsers ask of a walk, and passes it on."""

    def __init__(self, start: Start, send: Callable[[bytes], None]) -> None:
        self._start, self._send = start, send

    def __call__(self, message: str) -> str:
        """Empty, or why the message is refused."""
        try:
            asked = ASKED.validate_json(message)
            if isinstance(asked, Set):
                plant_of(self._start.plant, asked.settings)
        except ValidationError as error:
            return refused(fault(error))
        if isinstance(asked, PushNow) and self._start.plant.plant == "rigid":
            return "push: expected the plant pybullet or mujoco"
        self._send(asked.model_dump_json().encode())
        return ""


async def serve_play(start: Start, port: int, opens_browser: bool) -> None:
    """Play and serve until Ctrl-C, or until the player has ended.

    Raises:
        PageError: the port is taken.
    """
    here, process = begin(start)
    ended, broadcast = asyncio.Event(), Broadcast()
    loop = asyncio.get_running_loop()
    loop.add_reader(here.fileno(), pass_on, here, broadcast, ended)
    try:
        await serve_until(ended, broadcast, Door(start, here.send_bytes), port, opens_browser)
    finally:
        loop.remove_reader(here.fileno())
        here.close()
        process.join(timeout=5)


def begin(start: Start) -> tuple[Connection, Any]:
    """The player's process and the connection to it."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=play, args=(there, start), daemon=True)
    process.start()
    there.close()
    return here, process


def play(connection: Connection, start: Start) -> None:
    """The player's process, which alone imports the engines."""
    from rabbit_play.player import play

    play(connection, start)


def pass_on(connection: Connection, broadcast: Broadcast, ended: asyncio.Event) -> None:
    """Take what the player sent."""
    try:
        while connection.poll():
            tell(broadcast, connection.recv_bytes())
    except (EOFError, ConnectionResetError):
        ended.set()


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
