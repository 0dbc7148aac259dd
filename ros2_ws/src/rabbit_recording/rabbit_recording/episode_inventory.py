"""What a recording holds of its episodes: what was recorded, what was merely announced, what was lost.

A tick is recorded if its state, its torque and what else its controller publishes of a tick all are; an episode is if
one of its states is. Announcements are latched: a recorder that is started late also receives those of episodes that
were over by then.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from heapq import heappop, heappush
from typing import Any

from rabbit_description.state import TICK_SECONDS, StonePreview, newest_preview

from rabbit_recording.stored_messages import StoredMessage

DETAILS = ("controller_state", "learner_terms")  # a controller of another kind may publish none
BY_TICK = ("state", "torque", *DETAILS, "parameters")
OPTIONAL = (*DETAILS, "parameters")  # which only the simulator of a control task publishes
OTHERS = ("preview", "landing", "episode", "timing")
ENDED = 3  # phase in rabbit_msgs/Episode
NEIGHBOURS = 2  # episodes back, of which messages may still come
LEAST_TICK = 1e-6  # s
MOST_CLAIMS = 8  # messages kept that claim to be one; more controllers are in no graph
MOST_UNHEARD = 1000  # episodes between recorded ones; more are a damaged number
UNANSWERED = ("silent", "fault", "reset")  # outcomes that may come before the controller's last answer


class Presence(StrEnum):
    """What of an episode is in a recording: a tick; nothing, but of one before and one after; an announcement alone."""

    RECORDED = "recorded"
    LOST = "lost"
    ANNOUNCED = "announced"


@dataclass
class EpisodeInventory:
    """One episode.

    `first` and `last` recorded tick, None if there is none; `recorded`, `lost`: how many. Lost are those that are not
    whole between these two, and up to the episode's end if that was announced. `begins`, `ends`: tick 0, and the
    announcement of the end, are in the recording. `controller`: whose torques acted; `refused_controller`: another one
    that answered too.
    """

    number: int
    presence: Presence = Presence.RECORDED
    seed: int = 0
    stones: int = 0
    touchdowns: int = 0
    outcome: str = ""
    reason: str = ""
    controller: str = ""
    refused_controller: str = ""
    first: int | None = None
    last: int | None = None
    recorded: int = 0
    lost: int = 0
    begins: bool = False
    ends: bool = False
    policies: list[str] = field(default_factory=list)
    tick_seconds: float = TICK_SECONDS


ANNOUNCED = ("seed", "stones", "touchdowns", "outcome", "reason", "controller", "refused_controller")
Ticks = dict[str, dict[int, StoredMessage]]  # by topic and tick


class Gathered:
    """The messages of one episode."""

    def __init__(self, episode: int, followed: Collection[tuple[str, str]] = ()) -> None:
        """`followed`: what was heard in earlier episodes, so that the recorder was there: see `kinds`."""
        self.episode, self._followed = episode, followed
        self.previews: dict[int, dict[int, StonePreview]] = defaultdict(dict)  # by index of the stone and stamp
        self.landings: dict[int, Any] = {}
        self.announced: Any = None  # the newest announcement
        self._in_real_time = False
        # by topic and tick, what claims to be its message
        self._heard: dict[str, dict[int, list[StoredMessage]]] = {name: {} for name in BY_TICK}

    def add(self, message: StoredMessage) -> None:
        """Take in one; what comes again, byte by byte, counts once."""
        if message.topic in BY_TICK:
            here = self._heard[message.topic].setdefault(message.turn[1], [])
            if len(here) < MOST_CLAIMS and all(message.data != claim.data for claim in here):
                here.append(message)
        elif message.topic == "timing":
            self._in_real_time = True
        elif message.topic == "preview":
            m = message.decode()
            self.previews[m.index].setdefault(message.stamp, StonePreview(m.index, m.l_min, m.l_max, m.height))
        elif message.topic == "landing":
            landing = message.decode()
            self.landings.setdefault(landing.index, landing)
        elif self.announced is None or self.announced.phase != ENDED:
            self.announced = message.decode()

    def preview(self, index: int, now: int) -> StonePreview | None:
        """The preview of the stone first seen at a time (ns): announced then, else the newest before, else any."""
        previews = self.previews.get(index, {})
        return newest_preview(previews, now) or next(iter(previews.values()), None)

    @property
    def ticks(self) -> Ticks:
        """Messages by topic and tick, of the simulator and the controller that walked."""
        ticks: Ticks = {}
        for topic, heard in self._heard.items():
            messages = {tick: self._true_one(topic, claims) for tick, claims in heard.items()}
            ticks[topic] = {tick: message for tick, message in messages.items() if message}
        return ticks

    def _true_one(self, topic: str, claims: list[StoredMessage]) -> StoredMessage | None:
        """The claim of the simulator that announced the episode, or of the controller whose torques acted; None: of
        neither."""
        said, is_state = self.announced, topic in ("state", "parameters")
        if said is None or (len(claims) == 1 and (is_state or not said.refused_controller)):
            return claims[0]
        who = said.sender if is_state else said.controller
        return next((claim for claim in claims if claim.decode().sender == who), None)

    @property
    def _tick_seconds(self) -> float:
        """The tick's length as announced; where it cannot be, RABBIT's."""
        seconds = float(self.announced.tick_seconds) if self.announced else TICK_SECONDS
        return seconds if LEAST_TICK <= seconds < math.inf else TICK_SECONDS

    @staticmethod
    def kinds(ticks: Ticks) -> dict[str, tuple[str, str]]:
        """What each topic's messages are: any controller's, or details that this episode's controller publishes."""
        answers = (message for topic in ("torque", *DETAILS) for message in ticks[topic].values())
        walker = next((message.decode().sender for message in answers), "")
        return {topic: (topic, walker if topic in DETAILS else "") for topic in BY_TICK}

    def full_ticks(self, ticks: Ticks) -> list[int]:
        """The ticks of which there is all that is published of one."""
        wanted = [t for t, kind in self.kinds(ticks).items() if t not in OPTIONAL or ticks[t] or kind in self._followed]
        return sorted(set.intersection(*(set(ticks[topic]) for topic in wanted)))

    def inventory(self, presence: Presence) -> EpisodeInventory:
        """What there is."""
        ticks, said = self.ticks, self.announced
        there = EpisodeInventory(self.episode, presence)
        if said is not None:
            vars(there).update({name: getattr(said, name) for name in ANNOUNCED})
            there.ends, there.tick_seconds = bool(there.outcome), self._tick_seconds
        if full := self.full_ticks(ticks):
            there.first, there.last, there.recorded, there.begins = full[0], full[-1], len(full), full[0] == 0
        there.policies = [*dict.fromkeys(ticks["torque"][tick].decode().policy_version for tick in full)]
        if presence is Presence.LOST:
            there.lost = max(said.tick, 1) if there.ends else 1
        elif presence is Presence.RECORDED:
            there.lost = self._lost(full)
        return there

    def _lost(self, full: list[int]) -> int:
        """How many ticks are not whole between the first that is and the end; a damaged number makes that very long."""
        begin, end, said = full[0] if full else 0, full[-1] + 1 if full else 0, self.announced
        if self._followed:  # the recorder was there before
            begin = 0
        if said is not None and said.outcome and not self._in_real_time and said.outcome not in UNANSWERED:
            end = max(end, said.tick)
        return end - begin - len(full)


class Gathering:
    """Sorts messages into episodes and judges one once no more can come; only a few are kept at a time."""

    def __init__(self) -> None:
        self._open: dict[int, Gathered] = {}
        self._order: list[int] = []  # a heap of its keys
        self._reached = 0  # episode of the newest state that follows another
        self.newest = (0, 0)  # episode and tick of the newest state
        self._recorded = 0  # the newest recorded episode; 0: none yet
        self._unclear: dict[int, Gathered] = {}  # announced since then
        self._unheard = 0  # episodes, so far
        self._followed: set[tuple[str, str]] = set()  # heard

    def add(self, message: StoredMessage) -> None:
        """Take in one message, in the order of time."""
        number = message.turn[0]
        if message.topic == "state":
            episode, tick = self.newest
            if message.turn in ((episode, tick), (episode, tick + 1), (episode + 1, 0)):
                self._reached = number
            self.newest = message.turn
        if number not in self._open:
            self._open[number] = Gathered(number, self._followed)
            heappush(self._order, number)
        self._open[number].add(message)

    def finished(self, all_of_them: bool = False) -> Iterator[tuple[Gathered, EpisodeInventory]]:
        """The episodes that get no more messages, in their order."""
        while self._order and (all_of_them or self._order[0] < self._reached - NEIGHBOURS):
            yield from self._judge(self._open.pop(heappop(self._order)))
        if all_of_them:
            yield from self._announced()

    def _judge(self, episode: Gathered) -> Iterator[tuple[Gathered, EpisodeInventory]]:
        ticks, is_announced = episode.ticks, episode.announced is not None
        if ticks["state"] and (is_announced or episode.full_ticks(ticks)):  # somebody answered or announced it
            yield from self._lost(episode.episode) if self._recorded else self._announced()
            yield episode, episode.inventory(Presence.RECORDED)
            self._recorded, self._unclear = episode.episode, {}
        elif is_announced and episode.episode:
            self._unclear[episode.episode] = episode
        self._followed |= {kind for topic, kind in episode.kinds(ticks).items() if ticks[topic]}

    def _announced(self) -> Iterator[tuple[Gathered, EpisodeInventory]]:
        yield from ((episode, episode.inventory(Presence.ANNOUNCED)) for episode in self._unclear.values())
        self._unclear = {}

    def _lost(self, before: int) -> Iterator[tuple[Gathered, EpisodeInventory]]:
        unheard = range(self._recorded + 1, before)[: MOST_UNHEARD - self._unheard]
        self._unheard += len(unheard)
        for number in unheard:
            episode = self._unclear.get(number) or Gathered(number)
            yield episode, episode.inventory(Presence.LOST)
