"""A recorder that begins late, misses messages and is killed: what was recorded, what merely announced, what lost.

A graph is a list of messages in the order in which they were sent. A recorder that begins somewhere in it receives the
latched ones from before as history, then those that follow.
"""

import random
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from rabbit_description.gait import load_gait
from rabbit_recording.active_settings import Settings
from rabbit_recording.bag_writer import BagWriter
from rabbit_recording.commands.bag import app
from rabbit_recording.episode_inventory import BY_TICK, UNANSWERED, Presence
from rabbit_recording.message_header import SimulatedTime
from rabbit_recording.reader import iterate_inventories
from recorded_walk import (
    LATCHED,
    TICK_NS,
    TOPICS,
    TYPES,
    Walk,
    details,
    message,
    state_message,
    terms,
    told,
)
from rl_cbf_clf_controller.parameters import ControllerParameters
from typer.testing import CliRunner

HISTORY = 20  # latched messages of a topic
WAITING, RUNNING, ENDED = 0, 1, 3
EVENTS = ("episode", "preview", "landing")
PUBLISHER = dict.fromkeys(("torque", "controller_state", "learner_terms"), "controller")
TURN = 24  # bytes before episode and tick: CDR header, stamp, the name `world`


@dataclass(frozen=True)
class Sent:
    """A message with the simulator's process that sent it, or in whose time its controller did."""

    topic: str
    process: int
    episode: int
    tick: int
    data: bytes
    ended: str = ""


class Templates(dict[str, bytes]):
    """A tick's messages by topic."""

    def __repr__(self) -> str:
        """In short."""
        return "templates"


@dataclass
class Graph:
    """A simulator that walks, and may be started again; `sent` is all that was published."""

    templates: Templates
    sent: list[Sent] = field(default_factory=list)
    process: int = -1
    clock: int = 0
    episode: int = 0

    def start(self) -> None:
        """A simulator comes up; by its memory a second one goes on with episode and clock."""
        self.process += 1
        if self.process:
            self.announce(ENDED, self.sent[-1].tick, "reset")
        else:
            self.announce(WAITING)

    def walk(self, ticks: int, breaks_off: bool = False) -> None:
        """An episode of so many ticks; one that breaks off has neither a last state nor an end."""
        self.episode += 1
        self.announce(RUNNING)
        for tick in range(ticks):
            if tick % 3 == 0:
                self.send("preview", tick, message("preview", 0, index=tick // 3 + 1, l_min=0.3, l_max=0.4, height=0.0))
            for topic in BY_TICK:
                self.send(topic, tick)
            self.clock += 1
        if breaks_off:
            return
        self.send("state", ticks)
        landing = {"index": 1, "l": 0.3, "l_min": 0.2, "l_max": 0.4, "on_stone": True}
        self.send("landing", ticks, message("landing", 0, **landing))
        self.announce(ENDED, ticks, "walked")

    def announce(self, phase: int, tick: int = 0, outcome: str = "") -> None:
        """The simulator says where it stands."""
        fields = {"seed": 7, "stones": 2, "touchdowns": 0, "reason": "", "policy_version": "", "sigma": 0.0}
        self.send("episode", tick, message("episode", 0, phase=phase, outcome=outcome, **fields), outcome)

    def send(self, topic: str, tick: int, what: Any = None, ended: str = "") -> None:
        """At the present time; a tick's messages are those of a template, with their time, episode and tick."""
        seconds, nanoseconds = divmod(self.clock * TICK_NS, 10**9)
        if what is None:
            data = bytearray(self.templates[topic])
            struct.pack_into("<iI", data, 4, seconds, nanoseconds)
            struct.pack_into("<II", data, TURN, self.episode, tick)
        else:
            what.header.stamp.sec, what.header.stamp.nanosec, what.episode = seconds, nanoseconds, self.episode
            if topic == "episode":
                what.tick = tick
            data = bytearray(TYPES.serialize_cdr(what, f"rabbit_msgs/msg/{TOPICS[topic]}"))
        self.sent.append(Sent(topic, self.process, self.episode, tick, bytes(data), ended))


@pytest.fixture(scope="module")
def templates(walk: Walk) -> Templates:
    """A tick's messages."""
    record = walk.records[0]
    torque = message("torque", 0, torque=record.output.torque, policy_version="zero", fault="")
    found = {"state": state_message(record.state), "torque": torque}
    found |= {"controller_state": details(record), "learner_terms": terms(record)}
    data = {name: bytes(TYPES.serialize_cdr(m, f"rabbit_msgs/msg/{TOPICS[name]}")) for name, m in found.items()}
    return Templates(data)


def history(sent: list[Sent], begin: int) -> list[tuple[int, Sent]]:
    """What a recorder that begins there receives of before: the newest latched messages of the process that runs."""
    before = [(i, each) for i, each in enumerate(sent[:begin]) if each.process == sent[begin].process]
    return [pair for topic in EVENTS for pair in [p for p in before if p[1].topic == topic][-HISTORY:]]


def arrive(past: list[tuple[int, Sent]], live: list[tuple[int, Sent]], rng: random.Random) -> list[tuple[int, Sent]]:
    """History comes in before, between and after the first live messages, each topic in its order."""
    queues = [[p for p in past if p[1].topic == topic] for topic in EVENTS] + [live[:12]]
    mixed = []
    while any(queues):
        mixed.append(rng.choice([queue for queue in queues if queue]).pop(0))
    return mixed + live[12:]


def record(path: Path, arrived: Iterable[tuple[int, Sent]], times: Any = None) -> None:
    """As the recorder does."""
    times = times or SimulatedTime(path)
    writer = BagWriter(path, TYPES)
    for topic, name in TOPICS.items():
        writer.add(f"/{topic}", f"rabbit_msgs/msg/{name}", [LATCHED])
    for _, each in arrived:
        at = times.of(each.topic, PUBLISHER.get(each.topic, "simulator"), each.data)
        writer.write(f"/{each.topic}", at, each.data)
    writer.close()


Row = tuple[int, Presence, list[int], int, bool]  # number, what there is, ticks in full, lost, ends


def expected(sent: list[Sent], live: set[int], past: set[int]) -> list[Row]:
    """What a recording of the messages `live` holds, by docs/recordings.md; `past` came as history."""
    rows: list[Row] = []
    recorded = sorted({sent[i].episode for i in live if sent[i].topic == "state"})
    announced = {sent[i].episode for i in live | past if sent[i].topic == "episode"} - {0}
    between = set(range(recorded[0], recorded[-1])) if recorded else set()
    told = {"state", "torque"}  # and, from the first of its messages on, what else the controller publishes
    for number in sorted(announced | set(recorded) | between):
        its = {i: each for i, each in enumerate(sent) if each.episode == number}
        ends = next((e.tick for i, e in its.items() if e.ended and i in live | past), None)
        outcome = next((e.ended for i, e in its.items() if e.ended), "")
        kept = {t: {e.tick for i, e in its.items() if i in live and e.topic == t} for t in BY_TICK}
        if number in recorded:
            lost: set[int] = set()
            for topic in BY_TICK:
                here = [i for i, each in its.items() if each.topic == topic]
                begin = min((i for i in live if sent[i].topic == topic), default=len(sent))
                is_answered = topic == "state" or outcome not in UNANSWERED
                last = max((i for i in here if i in live), default=-1)
                end = len(sent) if ends is not None and is_answered else last
                missed = {its[i].tick for i in here if begin < i < end and i not in live}
                lost |= {tick for tick in missed if ends is None or tick < max(ends, max(kept[topic], default=0))}
            told |= {topic for topic in BY_TICK if kept[topic]}
            row = Presence.RECORDED, sorted(set.intersection(*(kept[topic] for topic in told))), len(lost)
        elif number in between:
            row = Presence.LOST, [], max(ends, 1) if ends is not None else 1
        else:
            row = Presence.ANNOUNCED, [], 0
        rows.append((number, *row, ends is not None))
    return rows


def found(path: Path) -> list[Row]:
    """What the reader says."""
    rows: list[Row] = []
    for each in iterate_inventories(path):
        ticks = [] if each.first is None else [each.first, each.last]
        assert each.begins == (each.first == 0)
        rows.append((each.number, each.presence, [*ticks, each.recorded], each.lost, each.ends))
    return rows


def in_short(rows: list[Row]) -> list[Row]:
    """First and last tick and their number, in place of all of them."""
    return [(*row[:2], [*row[2][:1], *row[2][-1:], len(row[2])], *row[3:]) for row in rows]


def read_and_expected(
    path: Path,
    templates: Templates,
    walked: tuple[list[int], bool, list[int]],
    part: tuple[float, float],
    drops: float,
    rng: random.Random,
) -> tuple[list[Row], list[Row]]:
    """What a recording of a `part` of a walk is read as, and what it holds.

    `walked`: the episodes' ticks, whether the simulator was started again, and the episodes' ticks after that.
    """
    (lengths, restart, more), (begin, end) = walked, part
    graph = Graph(templates)
    graph.start()
    for i, ticks in enumerate(lengths):
        graph.walk(ticks, breaks_off=restart and i + 1 == len(lengths))
    if restart:
        graph.start()
        for ticks in more:
            graph.walk(ticks)
    sent = graph.sent
    first = int(begin * (len(sent) - 1))
    last = first + 1 + int(end * (len(sent) - first - 1))
    dropped = {i for i in range(first, last) if sent[i].topic in BY_TICK and rng.random() < drops}
    past, live = history(sent, first), [(i, sent[i]) for i in range(first, last) if i not in dropped]
    record(path, arrive(past, live, rng))
    return found(path), in_short(expected(sent, {i for i, _ in live}, {i for i, _ in past}))


@pytest.mark.parametrize("seed", range(60))
def test_recorded_announced_and_lost_are_told_apart(tmp_path: Path, templates: Templates, seed: int) -> None:
    """Walks, restarts, parts and losses drawn at random; of 300 draws with losses at a start, one is misread."""
    rng = random.Random(seed)
    lengths = [rng.randint(1, 7) for _ in range(rng.randint(1, 14))]
    more = [rng.randint(1, 7) for _ in range(rng.randint(1, 4))]
    walked = lengths, rng.choice([False, True]), more
    part = rng.random(), rng.random()
    drops = rng.choice([0.0, 0.02, 0.3])
    read, holds = read_and_expected(tmp_path / "bag", templates, walked, part, drops, rng)
    assert read == holds


def test_messages_of_somebody_else_make_no_episodes(tmp_path: Path, templates: Templates) -> None:
    """States of another episode or tick than their time's, and a first word, in the middle of a walk."""
    graph = Graph(templates)
    graph.start()
    graph.walk(8)
    graph.walk(8)
    live = list(enumerate(graph.sent))
    whole = expected(graph.sent, set(range(len(live))), set())
    at = next(i for i, each in live if (each.topic, each.episode, each.tick) == ("torque", 2, 4))
    junk = []
    for episode, tick in ((1002, 4), (2, 1004), (2, 3), (3, 4), (1, 4)):
        data = bytearray(graph.sent[at - 1].data)
        struct.pack_into("<II", data, TURN, episode, tick)
        junk.append((at, replace(graph.sent[at - 1], data=bytes(data))))
    record(tmp_path / "bag", [*live[:at], *junk, (at, graph.sent[0]), *live[at:]])
    assert found(tmp_path / "bag") == in_short(whole)


def told_settings(episode: int, tick: int, eps: float) -> Any:
    """What the controller says that it goes by."""
    parameters = ControllerParameters(eps=eps)
    gait = load_gait(parameters.gait).model_dump_json()
    what = message("controller_settings", tick, parameters=parameters.model_dump_json(), gait=gait)
    what.episode = episode
    return what


def in_force(settings: Settings, episode: int) -> list[tuple[int, float]]:
    """From which tick which eps holds."""
    return [(each.tick, each.parameters.eps) for each in settings.of(episode)]


def test_a_controller_started_again_holds_from_the_next_episode_on() -> None:
    told_so_far = Settings()
    told_so_far.add(told_settings(0, 0, 0.1), (0, 0))
    told_so_far.add(told_settings(2, 5, 0.2), (2, 4))
    told_so_far.add(told_settings(0, 0, 0.3), (3, 7))
    assert in_force(told_so_far, 2) == [(0, 0.1), (5, 0.2)]
    assert in_force(told_so_far, 3) == [(0, 0.2)]
    assert in_force(told_so_far, 4) == [(0, 0.3)]


@pytest.fixture
def late(tmp_path: Path, walk: Walk) -> Path:
    """The walk as episode 3 from tick 40 on and as episode 4, recorded late: settings and policy are history."""
    writer = BagWriter(tmp_path / "bag", TYPES)
    for topic, name in TOPICS.items():
        writer.add(f"/{topic}", f"rabbit_msgs/msg/{name}", [LATCHED])
    length = (len(walk.records) + 1) * TICK_NS
    for episode in (1, 2, 3, 4):
        for topic, tick, what in told(walk):
            is_live = episode == 4 or (episode == 3 and tick >= LATE)
            if not is_live and topic not in ("episode", "controller_settings", "policy_swap"):
                continue
            if topic in ("controller_settings", "policy_swap"):
                if episode > 1:
                    continue
                what.episode = 0
            else:
                what.episode = episode
                at = (episode - 1) * length + tick * TICK_NS
                what.header.stamp.sec, what.header.stamp.nanosec = divmod(at, 10**9)
            data = bytes(TYPES.serialize_cdr(what, f"rabbit_msgs/msg/{TOPICS[topic]}"))
            writer.write(f"/{topic}", (episode - 1) * length + tick * TICK_NS, data)
    writer.close()
    return tmp_path / "bag"


LATE = 40  # tick


def test_check_replays_what_begins_and_says_why_not_the_rest(late: Path, walk: Walk) -> None:
    """The controller's settings came as history."""
    done = CliRunner().invoke(app, ["check", str(late)])
    n = len(walk.records)
    assert done.output.splitlines() == [
        f"episode 3: {n - LATE} ticks, 0 lost, 0 replayed, a replay begins at tick 0, which is not in it",
        f"episode 4: {n} ticks, 0 lost, {n} replayed, torques identical",
    ]
    assert done.exit_code == 0
