"""What all browsers of a page are to know: one episode's rows so far, and the newest word of each kind.

A browser that comes late, or was slow, gets what it lacks in one piece. So nobody waits for anybody.
"""

import asyncio
import json
from collections.abc import AsyncGenerator, Callable
from functools import partial
from threading import Lock
from typing import Any

from rabbit_viewer.page.rows import NUMBER

OF_AN_EPISODE = ("ended", "swap", "note", "explained")  # words that the next one makes void
KEPT_BYTES = 64_000_000  # of an episode's rows; the older half goes when there are more


class Broadcast:
    """`begin`, `say` and `add` may be called in any thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._episode = 0
        self._words: dict[str, tuple[int, str]] = {}  # by kind: number, JSON
        self._spoken = 0
        self._rows = bytearray()
        self._left_out = 0  # bytes of this episode that are no longer kept
        self._wakers: list[Callable[[], object]] = []  # of those who follow

    @property
    def followers(self) -> int:
        """Who reads."""
        return len(self._wakers)

    def begin(self, about: dict[str, Any]) -> None:
        """Another episode: `about` says what its rows are."""
        with self._lock:
            self._episode += 1
            self._rows, self._left_out = bytearray(), 0
            self._words = {kind: word for kind, word in self._words.items() if kind not in OF_AN_EPISODE}
            self._say("about", about)
        self._wake()

    def say(self, kind: str, word: dict[str, Any]) -> None:
        """The newest of its kind. Raises: ValueError: NaN, for which JSON has no word."""
        with self._lock:
            self._say(kind, word)
        self._wake()

    def add(self, rows: bytes) -> None:
        """Further rows, float32."""
        with self._lock:
            self._rows += rows
            if len(self._rows) > KEPT_BYTES:
                gone = len(self._rows) // 2 // self._row_bytes * self._row_bytes
                del self._rows[:gone]
                self._left_out += gone
        self._wake()

    async def follow(self) -> AsyncGenerator[list[str | bytes]]:
        """What is new, again and again, first all that is known: words are text, rows are bytes."""
        episode, heard, at = -1, 0, 0
        changed = asyncio.Event()
        wake = partial(asyncio.get_running_loop().call_soon_threadsafe, changed.set)
        self._wakers.append(wake)
        try:
            while True:
                changed.clear()
                with self._lock:
                    if episode != self._episode:
                        episode, at = self._episode, 0
                    new: list[str | bytes] = [word for number, word in sorted(self._words.values()) if number > heard]
                    heard = self._spoken
                    if rows := bytes(self._rows[max(at - self._left_out, 0) :]):
                        at = self._left_out + len(self._rows)
                        new.append(rows)
                if new:
                    yield new
                await changed.wait()
        finally:
            self._wakers.remove(wake)

    @property
    def known(self) -> tuple[list[dict[str, Any]], bytes]:
        """All words in the order in which they were said, and the rows."""
        with self._lock:
            return [json.loads(word) for _, word in sorted(self._words.values())], bytes(self._rows)

    @property
    def _row_bytes(self) -> int:
        about = json.loads(self._words["about"][1])
        return NUMBER.itemsize * sum(len(walker["columns"]) for walker in about["walkers"])

    def _say(self, kind: str, word: dict[str, Any]) -> None:
        self._spoken += 1
        self._words[kind] = self._spoken, json.dumps({"type": kind, **word}, allow_nan=False)

    def _wake(self) -> None:
        for wake in tuple(self._wakers):
            wake()
