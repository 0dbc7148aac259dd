"""The processes of `rabbit play`, and the page between them and the browsers.

A process tells its news through a pipe, as methods of `Broadcast` with arguments: see `tell`. What browsers ask waits
in a queue, from which the player takes it between two ticks. The page never waits for a process.
"""

import multiprocessing
import os
import queue
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.queues import Queue
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError
from rabbit_common.child_process import end_with_parent
from rabbit_description.validation import fault

from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.files import write_page
from rabbit_viewer.page.server import PageServer, refused
from rabbit_viewer.play.learning import learn
from rabbit_viewer.play.messages import ASKED, Asked, Choose, Learned, Push
from rabbit_viewer.play.settings import PlayError, PlaySettings, Start, plant_of

BUSY = "the walk has not yet done what was asked before: ask again"
FILM = ".mp4"
MOST_WAITING = 100  # messages for the player
ENDING_SECONDS = 0.7  # for a process to close what it has opened
SPAWN = multiprocessing.get_context("spawn")


class Door:
    """Hands what browsers ask to `put`, which may raise `queue.Full`, if it passes `check`; see `check_walk`."""

    def __init__(self, check: Callable[[Asked], object], put: Callable[[Asked], object]) -> None:
        self._check, self._put = check, put

    def __call__(self, message: str) -> str:
        """Empty, or why the message is refused."""
        try:
            asked = ASKED.validate_json(message)
            self._check(asked)
            self._put(asked)
        except ValidationError as error:
            return refused(fault(error, equals=" "))
        except PlayError as error:
            return refused(error)
        except queue.Full:
            return BUSY
        return ""


def check_walk(start: Start, asked: Asked) -> None:
    """Whether it can be asked of a walk; raises `ValidationError`, `PlayError`."""
    if isinstance(asked, Choose):
        settings = PlaySettings.model_validate(asked.settings)
        plant_of(start.plant, settings)
        start.check(settings)
    if isinstance(asked, Push) and start.plant.plant == "rigid":
        raise PlayError("push: expected the plant pybullet or mujoco")


def serve_play(start: Start, port: int, opens_browser: bool) -> None:
    """Play a walk, and serve it with what learns beside it; see `serve`."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="rabbit_play_"))) if start.learns else None
        beside = [(learn, start, folder)] if folder else []
        serve(partial(check_walk, start), play, start, port, opens_browser, beside)


def serve(
    check: Callable[[Asked], object],
    player: Callable[..., None],
    start: Any,
    port: int,
    opens_browser: bool,
    beside: Sequence[tuple[Any, ...]] = (),
) -> None:
    """Play and serve until Ctrl-C or SIGTERM, or until the player has ended.

    `player` is called in another process with what it sends by, `start`, and what is asked, if it passes `check`; so
    are the targets `beside`, with their arguments.

    Raises:
        PageError: the port is taken.
        PlayError: what is given cannot walk.
    """
    broadcast, wishes = Broadcast(), SPAWN.Queue(MOST_WAITING)
    wishes.cancel_join_thread()  # what the player has not taken at the end is lost
    with ExitStack() as stack:
        page = PageServer(broadcast, Door(check, wishes.put_nowait), port)
        stack.enter_context(closing(page))
        stack.enter_context(suppress(KeyboardInterrupt))
        playing = stack.enter_context(process(player, start, wishes))
        sources = [playing, *(stack.enter_context(process(*target, wishes)) for target in beside)]
        page.announce(opens_browser)  # with its processes begun, which a flood of connections would keep from beginning
        while playing in sources:
            ready: list[Any] = wait(sources)
            for source in ready:
                try:
                    tell(broadcast, *source.recv())
                except (EOFError, ConnectionError):
                    sources.remove(source)


def tell(broadcast: Broadcast, method: str, *arguments: Any) -> None:
    """What a process sends: a method of `Broadcast` with its arguments, or `fail` with the line of a `PlayError`."""
    if method == "fail":
        raise PlayError(*arguments)
    getattr(broadcast, method)(*arguments)


@contextmanager
def process(target: Callable[..., None], *arguments: Any) -> Iterator[Connection]:
    """A process that calls `target(send, *arguments)`, and from which one reads what it sends.

    On leaving it ends, at the latest after `ENDING_SECONDS`.
    """
    here, there = SPAWN.Pipe(duplex=False)
    started = SPAWN.Process(target=until_ended, args=(os.getpid(), target, there, *arguments), daemon=True)
    started.start()
    there.close()
    try:
        yield here
    finally:
        started.terminate()
        started.join(ENDING_SECONDS)
        started.kill()  # the target has returned; all that is left is Python's own end
        started.join()
        here.close()


def until_ended(server: int, target: Callable[..., None], channel: Connection, *arguments: Any) -> None:
    """A process ends with the server or at SIGTERM, and closes what it opened; Ctrl-C is for the server."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    end_with_parent(server)
    with channel, suppress(ConnectionError):
        target(lambda *message: channel.send(message), *arguments)


def play(send: Callable[..., None], start: Start, wishes: "Queue[Asked | Learned]") -> None:
    """The player's process, which alone imports the engines."""
    from rabbit_viewer.play import playing
    from rabbit_viewer.play.player import Player

    playing.play(Player, send, start, wishes)


def write_play(start: Start, path: Path) -> list[Path]:
    """Walk one episode as fast as it goes, and write it: a page, or a film and its GIF where the suffix is .mp4.

    Raises `PlayError`, `PageError`, `VideoError`.
    """
    from rabbit_viewer.play.player import Player
    from rabbit_viewer.video import film

    broadcast = Broadcast()
    with closing(Player(start, partial(tell, broadcast))) as player:
        while not player.has_ended:
            player.tick()
        player.say_state()
        if path.suffix == FILM:
            return film([walker.records for walker in player.walkers], path, gif=True)
    return [write_page(path, broadcast)]
