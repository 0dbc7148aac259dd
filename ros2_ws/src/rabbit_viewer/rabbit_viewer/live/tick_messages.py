"""Puts together what came on several topics for one tick, still as bytes: most ticks are never looked at."""

import struct

KEY = struct.Struct("<II")  # episode, tick
OFFSET = 12  # bytes before them: CDR header 4, stamp 8
KEPT = 16  # ticks that wait for their last part
Tick = tuple[int, int]


class TickMessages:
    """The newest tick of which there is a message on each of `topics`; all begin with stamp, episode, tick."""

    def __init__(self, *topics: str) -> None:
        self._topics = frozenset(topics)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._waiting: dict[Tick, dict[str, bytes]] = {}
        self.key: Tick | None = None
        self.parts: dict[str, bytes] = {}

    def add(self, topic: str, data: bytes) -> None:
        """Take a serialised message; one too short to have a tick is left out."""
        if len(data) < OFFSET + KEY.size:
            return
        episode, tick = KEY.unpack_from(data, OFFSET)
        key = (episode, tick)
        parts = self._waiting.setdefault(key, {})
        parts[topic] = data
        if parts.keys() == self._topics:
            self.key, self.parts = key, self._waiting.pop(key)
        elif len(self._waiting) > KEPT:
            del self._waiting[next(iter(self._waiting))]
