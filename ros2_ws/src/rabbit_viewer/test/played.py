"""A player without a clock, and what it has sent."""

import struct
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rabbit_description.state import Array
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.play.messages import ASKED
from rabbit_viewer.play.playing import Playing
from rabbit_viewer.play.serving import tell


class Played:
    """`make` gives the player."""

    def __init__(self, make: Callable[..., Playing], start: Any) -> None:
        self.broadcast = Broadcast()
        self.player: Any = make(start, partial(tell, self.broadcast))
        self.player.say_state()

    def ask(self, do: str, **more: Any) -> None:
        """As the server passes it on; settings go on top of those in force."""
        if "settings" in more:
            more["settings"] = {**self.words["state"]["settings"], **more["settings"]}
        self.player.take(ASKED.validate_python({"do": do, **more}))
        self.player.say_state()

    def go_on(self, ticks: int = 10_000) -> "Played":
        """So many ticks, or to the end."""
        for _ in range(ticks):
            if self.player.has_ended:
                break
            self.player.tick()
        self.player.say_state()
        return self

    @property
    def words(self) -> dict[str, Any]:
        """The newest of each kind."""
        return {word["type"]: word for word in self.broadcast.known[0]}

    def rows(self, walker: int = 0) -> dict[str, Array]:
        """Of one of those that are played, by column."""
        columns = [word["columns"] for word in self.words["about"]["walkers"]]
        data = self.broadcast.known[1]
        table = np.array(struct.unpack(f"<{len(data) // 4}f", data)).reshape(-1, sum(map(len, columns)))
        first = sum(map(len, columns[:walker]))
        return dict(zip(columns[walker], table[:, first:].T, strict=False))
