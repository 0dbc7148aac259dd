"""Puts a tick's messages together, in order: they come on several topics, in each in order, between them in any.

Where a topic has gone past a tick that it never delivered, the tick is lost: it is left out and counted, and the walk
goes on. An episode is over when all its ticks are there or lost, and its last state too.

Not everything that comes belongs: `Walk.judge` says what a message is by its episode and tick, before it is added.
"""

from dataclasses import dataclass, field
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


@dataclass
class TickSynchronizer:
    """The ticks of one episode. `parts` name what a tick needs; the first is the state."""

    parts: tuple[str, ...]
    lost: int = 0
    over: bool = False
    _next: int = 0
    _last: int | None = None
    _end: int = 0
    _held: dict[str, dict[int, Any]] = field(default_factory=dict)
    _newest: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._held = {part: {} for part in self.parts}
        self._newest = dict.fromkeys(self.parts, -1)

    def add(self, part: str, tick: int, message: Any) -> list[Event]:
        """Take in a message; returns what it completes, in order. None stands for one that was refused."""
        if message is not None:
            self._held[part][tick] = message
        self._newest[part] = max(tick, self._newest[part])
        return self._complete()

    def judge(self, part: str, tick: int) -> Judgement:
        """What a message is by its tick; `again`: the newest one once more."""
        newest = self._newest[part]
        if tick <= newest:
            return "again" if tick == newest else "late"
        return "good" if tick <= max(newest, self._next) + AHEAD else "wrong tick"

    def begin_at(self, tick: int) -> None:
        """The ticks before this one were not meant for us."""
        self._next = max(self._next, tick)

    def end(self, last: int, acted: bool = False) -> list[Event]:
        """The episode ends with the state of tick `last`; `acted`: there is an answer to that one too (a fault)."""
        self._last, self._end = last, last + acted
        return self._complete()

    @property
    def announced(self) -> bool:
        """The end was announced, but is not reached yet."""
        return self._last is not None and not self.over

    def flush(self) -> list[Event]:
        """Nothing more will come: what is missing is lost."""
        self._newest = dict.fromkeys(self.parts, max(self._end, *self._newest.values()) + 1)
        if self._last is None:
            self._last = self._end = max(self._held[self.parts[0]], default=self._next)
        return self._complete()

    def _complete(self) -> list[Event]:
        done: list[Event] = []
        while not self.over and (self._last is None or self._next < self._end):
            missing = [part for part in self.parts if self._next not in self._held[part]]
            if any(self._newest[part] <= self._next for part in missing):
                return done
            if missing:
                following = self._after_gap(missing)
                self.lost += following - self._next
                self._next = following
                self._forget_before(following)
            else:
                done.append(Tick(self._next, tuple(self._held[part][self._next] for part in self.parts)))
                self._forget(self._next - 1)
                self._next += 1
        return done + self._finish()

    def _after_gap(self, missing: list[str]) -> int:
        """The next tick that may be whole."""
        held = {part: [tick for tick in self._held[part] if tick > self._next] for part in missing}
        following = max(min(held[part], default=self._newest[part]) for part in missing)
        return following if self._last is None else min(following, self._end)

    def _finish(self) -> list[Event]:
        state = self.parts[0]
        if self.over or self._last is None or self._newest[state] < self._last:
            return []
        self.over = True
        return [End(self._held[state].get(self._last))]

    def _forget(self, tick: int) -> None:
        for held in self._held.values():
            held.pop(tick, None)

    def _forget_before(self, tick: int) -> None:
        for part, held in self._held.items():
            self._held[part] = {t: message for t, message in held.items() if t >= tick}


@dataclass
class Walk:
    """One episode after the other: the next one's ticks wait until the last one's are all there.

    `done` is the number of the last episode that is over, `announced` of the newest that the simulator told of.
    """

    parts: tuple[str, ...]
    done: int = 0
    announced: int = 0
    lost: int = 0
    _open: dict[int, TickSynchronizer] = field(default_factory=dict)
    _waiting: dict[int, list[Event]] = field(default_factory=dict)

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
            self._pairing(episode).begin_at(tick)

    def restart(self) -> list[tuple[int, Event]]:
        """The simulator counts from 1 again: nothing more will come of the open episodes."""
        events: list[tuple[int, Event]] = []
        while self._open:
            events += self.give_up()
        self.done = self.announced = 0
        return events

    def add(self, part: str, episode: int, tick: int, message: Any) -> list[tuple[int, Event]]:
        """Take in a message; returns events with their episode. What comes after its episode's end is ignored."""
        if episode <= self.done:
            return []
        return self._note(episode, self._pairing(episode).add(part, tick, message))

    def end(self, episode: int, last: int, acted: bool) -> list[tuple[int, Event]]:
        """Episode `episode` ends with the state of tick `last`, see `TickSynchronizer.end`."""
        if episode <= self.done:
            return []
        return self._note(episode, self._pairing(episode).end(last, acted))

    def give_up(self) -> list[tuple[int, Event]]:
        """Nothing more will come of the oldest open episode."""
        if not self._open:
            return []
        first = min(self._open)
        return self._note(first, self._open[first].flush())

    @property
    def is_held_up(self) -> bool:
        """Of the oldest open episode ticks have not come, though it is over, or a later one was announced."""
        return bool(self._open) and (self._open[min(self._open)].announced or min(self._open) < self.announced)

    def _pairing(self, episode: int) -> TickSynchronizer:
        self._waiting.setdefault(episode, [])
        return self._open.setdefault(episode, TickSynchronizer(self.parts))

    def _note(self, episode: int, events: list[Event]) -> list[tuple[int, Event]]:
        self._waiting[episode] += events
        out: list[tuple[int, Event]] = []
        while self._open:
            first = min(self._open)
            out += [(first, event) for event in self._waiting[first]]
            self._waiting[first] = []
            if not self._open[first].over:
                break
            self.lost += self._open.pop(first).lost
            del self._waiting[first]
            self.done = first
        return out
