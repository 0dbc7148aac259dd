"""Puts a tick's messages together, in order: they come on several topics, in each in order, between them in any.

Where a topic has gone past a tick that it never delivered, the tick is lost: it is left out and counted, and the walk
goes on. An episode is over when all its ticks are there or lost, and its last state too.

Not everything that comes belongs: `Walk.judge` says what a message is by its episode and tick, before it is added.
"""

from dataclasses import dataclass
from typing import Any, Literal

AHEAD = 5000  # ticks that a topic may jump: as many as a reader's history holds
Judgement = Literal["good", "again", "late", "wrong episode", "wrong tick"]


@dataclass(frozen=True)
class Tick:
    """All messages of a tick, in the order of the parts."""

    tick: int
    messages: tuple[Any, ...]


@dataclass(frozen=True)
class End:
    """An episode is over; `last` is the state it ended in, None if that was lost."""

    last: Any


Event = Tick | End


class TickSynchronizer:
    """The ticks of one episode. `parts` name what a tick needs; the first is the state.

    `events`: what is complete, in order, until somebody takes it. `lost`: ticks; `over`: the end is among the events.
    """

    def __init__(self, parts: tuple[str, ...]) -> None:
        self.events: list[Event] = []
        self.lost, self.over = 0, False
        self._parts = parts
        self._next, self._end = 0, 0
        self._last: int | None = None
        self._held: dict[str, dict[int, Any]] = {part: {} for part in parts}
        self._newest = dict.fromkeys(parts, -1)

    def add(self, part: str, tick: int, message: Any) -> None:
        """Take in a message; None stands for one that was refused."""
        if message is not None:
            self._held[part][tick] = message
        self._newest[part] = max(tick, self._newest[part])
        self._complete()

    def judge(self, part: str, tick: int) -> Judgement:
        """What a message is by its tick; `again`: the newest one once more."""
        newest = self._newest[part]
        if tick <= newest:
            return "again" if tick == newest else "late"
        return "good" if tick <= max(newest, self._next) + AHEAD else "wrong tick"

    def begin_at(self, tick: int) -> None:
        """The ticks before this one were not meant for us."""
        self._next = max(self._next, tick)

    def end(self, last: int, acted: bool = False) -> None:
        """The episode ends with the state of tick `last`; `acted`: there is an answer to that one too (a fault)."""
        self._last, self._end = last, last + acted
        self._complete()

    @property
    def announced(self) -> bool:
        """The end was announced, but is not reached yet."""
        return self._last is not None and not self.over

    def flush(self) -> None:
        """Nothing more will come: what is missing is lost."""
        self._newest = dict.fromkeys(self._parts, max(self._end, *self._newest.values()) + 1)
        if self._last is None:
            self._last = self._end = max(self._held[self._parts[0]], default=self._next)
        self._complete()

    def _complete(self) -> None:
        while not self.over and (self._last is None or self._next < self._end):
            missing = [part for part in self._parts if self._next not in self._held[part]]
            if any(self._newest[part] <= self._next for part in missing):
                return
            if missing:
                following = self._after_gap(missing)
                self.lost += following - self._next
                self._next = following
                self._held = {
                    part: {tick: message for tick, message in held.items() if tick >= following}
                    for part, held in self._held.items()
                }
            else:
                self.events.append(Tick(self._next, tuple(self._held[part][self._next] for part in self._parts)))
                for held in self._held.values():
                    held.pop(self._next - 1, None)
                self._next += 1
        state = self._parts[0]
        if not self.over and self._last is not None and self._newest[state] >= self._last:
            self.over = True
            self.events.append(End(self._held[state].get(self._last)))

    def _after_gap(self, missing: list[str]) -> int:
        """The next tick that may be whole."""
        held = {part: [tick for tick in self._held[part] if tick > self._next] for part in missing}
        following = max(min(held[part], default=self._newest[part]) for part in missing)
        return following if self._last is None else min(following, self._end)


class Walk:
    """One episode after the other: the next one's ticks wait until the last one's are all there.

    `done` is the number of the last episode that is over, `announced` of the newest that the simulator announced.
    """

    def __init__(self, parts: tuple[str, ...], done: int = 0, announced: int = 0) -> None:
        self.done, self.announced, self.lost = done, announced, 0
        self._parts = parts
        self._open: dict[int, TickSynchronizer] = {}

    def judge(self, part: str, episode: int, tick: int) -> Judgement:
        """What a message is, by its episode and tick."""
        if episode <= self.done:
            return "late"
        if episode > max(self.announced, self.done) + 1:
            return "wrong episode"
        return self._open[episode].judge(part, tick) if episode in self._open else "good"

    def join(self, episode: int, tick: int) -> None:
        """Begin to listen in the middle of an episode, if it is not open yet: what was before is not missed."""
        if episode not in self._open:
            self._ticks_of(episode).begin_at(tick)

    def restart(self) -> list[tuple[int, Event]]:
        """The simulator counts from 1 again: nothing more will come of the open episodes."""
        events: list[tuple[int, Event]] = []
        while self._open:
            events += self.give_up()
        self.done = self.announced = 0
        return events

    def add(self, part: str, episode: int, tick: int, message: Any) -> list[tuple[int, Event]]:
        """Take in a message; returns events with their episode. What comes after its episode's end is ignored."""
        if episode > self.done:
            self._ticks_of(episode).add(part, tick, message)
        return self._take_events()

    def end(self, episode: int, last: int, acted: bool) -> list[tuple[int, Event]]:
        """Episode `episode` ends with the state of tick `last`, see `TickSynchronizer.end`."""
        if episode > self.done:
            self._ticks_of(episode).end(last, acted)
        return self._take_events()

    def give_up(self) -> list[tuple[int, Event]]:
        """Nothing more will come of the oldest open episode."""
        if self._open:
            self._open[min(self._open)].flush()
        return self._take_events()

    @property
    def is_held_up(self) -> bool:
        """Of the oldest open episode ticks have not come, though it is over, or a later one was announced."""
        return bool(self._open) and (self._open[min(self._open)].announced or min(self._open) < self.announced)

    def _ticks_of(self, episode: int) -> TickSynchronizer:
        return self._open.setdefault(episode, TickSynchronizer(self._parts))

    def _take_events(self) -> list[tuple[int, Event]]:
        """Of the oldest open episode, and of the next where that is over."""
        taken: list[tuple[int, Event]] = []
        while self._open:
            first = min(self._open)
            ticks = self._open[first]
            taken += [(first, event) for event in ticks.events]
            ticks.events = []
            if not ticks.over:
                break
            self.lost += ticks.lost
            self.done = first
            del self._open[first]
        return taken
