"""Puts a tick's messages together, in order: they come on several topics, on one in order, between them in any.

A tick is settled once every topic has come so far. If a topic went past it without its message the tick is lost: left
out and counted, and the walk goes on. An episode is over when its end was announced, all its ticks are settled, and its
last state is there; the next one's ticks wait until then.
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


Event = tuple[int, Tick | End]  # with the number of its episode


@dataclass
class _Episode:
    """`held`: messages by tick and part; `newest`: ticks by part; `next`: to be settled; `state`: tick and newest.

    Once its end is announced: `last`, the tick of the last state, and `answers`, how many ticks have a torque.
    """

    newest: dict[str, int]
    held: dict[int, dict[str, Any]] = field(default_factory=dict)
    next: int = 0
    state: tuple[int, Any] = (-1, None)
    last: int | None = None
    answers: int = 0


class TickSynchronizer:
    """The ticks of one episode after the other. `parts` name what a tick needs; the first is the state.

    `done`: the last episode that is over; `announced`: the newest that the simulator announced; `lost`: ticks.
    """

    def __init__(self, parts: tuple[str, ...], done: int = 0, announced: int = 0) -> None:
        self.done, self.announced, self.lost = done, announced, 0
        self._parts = parts
        self._open: dict[int, _Episode] = {}

    def judge(self, part: str, episode: int, tick: int) -> Judgement:
        """What a message is before it is added, by its episode and tick; `again`: the newest one once more."""
        if episode <= self.done:
            return "late"
        if episode > max(self.announced, self.done) + 1:
            return "wrong episode"
        if episode not in self._open:
            return "good"
        newest = self._open[episode].newest[part]
        if tick <= newest:
            return "again" if tick == newest else "late"
        return "good" if tick <= max(newest, self._open[episode].next) + AHEAD else "wrong tick"

    def join(self, episode: int, tick: int) -> None:
        """Begin to listen in the middle of an episode, if it is not open yet: what was before is not missed."""
        if episode not in self._open:
            self._of(episode).next = tick

    def add(self, part: str, episode: int, tick: int, message: Any) -> list[Event]:
        """Take in a message, None for one that was refused; what comes after its episode's end is ignored."""
        if episode > self.done:
            walk = self._of(episode)
            walk.newest[part] = max(tick, walk.newest[part])
            if message is not None and tick >= walk.next:
                walk.held.setdefault(tick, {})[part] = message
                if part == self._parts[0]:
                    walk.state = max(walk.state, (tick, message), key=lambda state: state[0])
        return self._events()

    def end(self, episode: int, last: int, acted: bool) -> list[Event]:
        """An episode ends with the state of tick `last`; `acted`: there is an answer to that one too (a fault)."""
        if episode > self.done:
            walk = self._of(episode)
            walk.last, walk.answers = last, last + acted
        return self._events()

    def give_up(self) -> list[Event]:
        """Gives up what is missing of the oldest open episode: nothing more will come."""
        if self._open:
            walk = self._open[min(self._open)]
            if walk.last is None:
                walk.last = walk.answers = max(walk.state[0], walk.next)
            walk.newest = dict.fromkeys(self._parts, max(walk.last, *walk.newest.values()))
        return self._events()

    def restart(self) -> list[Event]:
        """The simulator counts from 1 again: nothing more will come of the open episodes."""
        events: list[Event] = []
        while self._open:
            events += self.give_up()
        self.done = self.announced = 0
        return events

    @property
    def is_held_up(self) -> bool:
        """Whether ticks of the oldest open episode have not come, though it is over, or a later one was announced."""
        first = min(self._open, default=None)
        return first is not None and (self._open[first].last is not None or first < self.announced)

    def _of(self, episode: int) -> _Episode:
        return self._open.setdefault(episode, _Episode(dict.fromkeys(self._parts, -1)))

    def _events(self) -> list[Event]:
        """What is settled of the oldest open episode, and of the next where that is over."""
        events: list[Event] = []
        while self._open:
            first = min(self._open)
            walk = self._open[first]
            settled = min(walk.newest.values())
            is_over = walk.last is not None and settled >= walk.answers - 1 and walk.newest[self._parts[0]] >= walk.last
            if walk.last is not None:
                settled = min(settled, walk.answers - 1)
            for tick in sorted(tick for tick in walk.held if tick <= settled):
                messages = walk.held.pop(tick)
                is_whole = len(messages) == len(self._parts)
                self.lost += tick - walk.next + (not is_whole)
                walk.next = tick + 1
                if is_whole:
                    events.append((first, Tick(tick, tuple(messages[part] for part in self._parts))))
            if not is_over:
                break
            self.lost += max(0, walk.answers - walk.next)
            events.append((first, End(walk.state[1] if walk.state[0] == walk.last else None)))
            self.done = first
            del self._open[first]
        return events
