"""Plays episodes in real time, as a person asks: of a walk (`player`), or of whatever else has ticks.

It takes a message between two ticks, more if there is time: so the episode goes on, however much is asked.
"""

import queue
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from multiprocessing.queues import Queue
from typing import Any, Protocol

from pydantic import BaseModel
from rabbit_common.guard import guarded, reason_of

from rabbit_viewer.page import Explain
from rabbit_viewer.page.rows import packed
from rabbit_viewer.play.settings import PlayError

STATE_SECONDS = 0.03  # from one look at whether the state has changed to the next
BEHIND = 0.25  # s, after which lost time is not caught up with
AGAIN_TICKS = 200  # after the end, before the next episode
Send = Callable[..., None]


class Shown(Protocol):
    """One of those that are played: a `row` a tick; `outcome` is empty until it has ended, `ended` says how."""

    row: list[float]

    @property
    def outcome(self) -> str: ...

    @property
    def about(self) -> dict[str, Any]: ...

    @property
    def ended(self) -> dict[str, Any]: ...

    def tick(self) -> None: ...

    def explain(self, tick: int) -> list[str]: ...


class Playing(ABC):
    """`walkers`: those that are played; `is_moving`: whether ticks are due; `seconds`: from one to the next.

    Settings are of a `model`; they have a `seed`, and `again`: what follows an end. `send`: see `serving.tell`.
    """

    tick_seconds: float
    model: type[BaseModel]
    unusable: tuple[type[Exception], ...]  # what `make_walkers` raises where settings cannot be played

    def __init__(self, settings: Any, send: Send) -> None:
        """Raises one of `unusable`."""
        self._send, self._chosen = send, settings
        self.walkers: Sequence[Shown] = []
        self.is_paused, self.speed = False, 1.0
        self._is_awaiting = True  # its first viewer
        self._has_changed = False  # the state, since it was sent
        self._is_reset_due = False
        self.reset()

    @abstractmethod
    def make_walkers(self, settings: Any) -> tuple[Sequence[Shown], dict[str, Any]]:
        """Makes the walkers for these settings, and their description for the page; raises one of `unusable`."""

    @abstractmethod
    def set(self, settings: Any) -> None:
        """What of the settings needs no reset acts at once."""

    def do(self, asked: Any) -> None:  # noqa: B027  most can do no more
        """What only some can: a push."""

    def close(self) -> None:  # noqa: B027  most hold nothing
        """Give back what is held."""

    @property
    def is_moving(self) -> bool:
        """Ticks are due."""
        return not (self.is_paused or self._is_awaiting) and (self._after_end == 0 or self._chosen.again != "wait")

    @property
    def has_ended(self) -> bool:
        """Nobody goes on any more."""
        return self._after_end > 0

    @property
    def seconds(self) -> float:
        """The time from one tick to the next."""
        return self.tick_seconds / self.speed

    def reset(self) -> None:
        """Begin again as chosen; raises one of `unusable` where that cannot be played, and nothing changes."""
        settings = self._chosen
        walkers, about = self.make_walkers(settings)
        self.close()
        self.walkers, self._settings = walkers, settings
        self._tick = self._after_end = 0
        common = {"mode": "play", "tick_seconds": self.tick_seconds, "explains": True}
        self._send("begin", {**common, **about, "walkers": [walker.about for walker in walkers]})
        self._has_changed = True

    def take(self, asked: Any) -> None:
        """Do what the server passes on; it has checked it."""
        what = getattr(asked, "do", "")
        self._is_awaiting &= what in ("", "explain")
        match what:
            case "explain":
                self._explain(asked)
            case "set":
                self.set(self.model.model_validate(asked.settings))
            case "reset":
                self._is_reset_due = True
            case "begin":
                self._chosen, self._is_reset_due = self.model.model_validate(asked.settings), True
            case "pause":
                self.is_paused = asked.paused
            case "tick":
                self.is_paused = True
                self.tick()
            case "speed":
                self.speed = asked.speed
            case _:
                self.do(asked)
        if self._is_reset_due and not self.is_moving:
            self._try_reset()
            self.tick()  # so that something is seen
        self._has_changed = True

    def tick(self) -> None:
        """Go on one tick, or to the next episode."""
        if self._after_end > AGAIN_TICKS:
            if self._chosen.again == "next course":
                self._chosen = self._chosen.model_copy(update={"seed": (self._chosen.seed + 1) % 2**31})
            self._is_reset_due = True
        if self._is_reset_due:
            self._try_reset()
        if self._after_end:
            self._after_end += 1
            return
        walking = [walker for walker in self.walkers if not walker.outcome]
        for walker in walking:
            walker.tick()
        self._send("add", packed([number for walker in self.walkers for number in walker.row]))
        self._tick += 1
        if any(walker.outcome for walker in walking):
            self.say("ended", {"walkers": [walker.ended for walker in self.walkers]})
            self._after_end = int(all(walker.outcome for walker in self.walkers))

    def say_state(self) -> None:
        """Say how everything stands, if that has changed."""
        if self._has_changed:
            self._has_changed = False
            chosen, in_force = (settings.model_dump(mode="json") for settings in (self._chosen, self._settings))
            waiting = [name for name in chosen if chosen[name] != in_force[name]]
            self.say("state", {"settings": chosen, "waiting": waiting, "paused": self.is_paused, "speed": self.speed})

    def say(self, kind: str, word: dict[str, Any]) -> None:
        """A word for all who watch."""
        self._send("say", kind, word)

    def _try_reset(self) -> None:
        self._is_reset_due = False
        try:
            self.reset()
        except self.unusable as error:
            self._chosen = self._settings
            self.say("note", {"text": " ".join(str(error).split())})
            self._has_changed = True

    def _explain(self, asked: Explain) -> None:
        lines = guarded(lambda: self.walkers[asked.walker].explain(asked.tick), lambda reason: [reason])()
        self.say("explained", {"walker": asked.walker, "tick": asked.tick, "lines": lines})


def play(make: Callable[[Any, Send], Playing], send: Send, start: Any, wishes: "Queue[Any]") -> None:
    """Play until the process ends; where nothing can be made of `start`, whatever that raises, say so."""
    try:
        player = make(start, send)
    except Exception as error:  # a file that is named may raise anything
        send("fail", str(error) if isinstance(error, PlayError) else reason_of(error))
        return
    take = guarded(player.take, lambda reason, asked: player.say("note", {"text": reason}))
    now = due = shown = time.monotonic()
    with closing(player):
        player.tick()  # so that something is seen
        while True:
            until = min(due, shown) if player.is_moving else shown
            with suppress(queue.Empty):
                take(wishes.get(timeout=max(until - now, 0)))
            now = time.monotonic()
            if not player.is_moving or now - due > BEHIND:
                due = now
            if player.is_moving and now >= due:
                player.tick()
                due += player.seconds
            if now >= shown:
                player.say_state()
                shown = now + STATE_SECONDS
