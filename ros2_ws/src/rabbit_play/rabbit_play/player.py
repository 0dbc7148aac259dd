"""Plays a walk: the robots on one course, in real time, as a person asks. Runs in a process of its own.

It sends to the server: `b"R"` and rows; `b"A"` and JSON, another episode; `b"W"`, a word (its kind, JSON); `b"E"`, a
line, if it cannot begin.
"""

import json
import struct
import time
from collections.abc import Callable
from contextlib import closing
from multiprocessing.connection import Connection
from typing import Any

from rabbit_description.gait import GaitError
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import AssemblyError
from rabbit_sim.stones import CourseError
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_play.messages import ASKED, LOAD, Asked, Pause, PushNow, Reset, Set, Speed, Tick
from rabbit_play.settings import COURSE, MOST_PUSHES, NOBODY, SHIPPED, PlaySettings, Push, Start, controls, plant_of
from rabbit_play.walker import Walker

SENT_TICKS = 3  # together
BEHIND = 0.25  # s, after which lost time is not caught up with
PACE_TICKS = 100  # over which the pace is measured
AGAIN_TICKS = 200  # after the end, before the next episode
UNUSABLE = (GaitError, CourseError, PolicyFileError, AssemblyError)
Send = Callable[[bytes], None]


class Player:
    """`is_moving`: whether ticks are due; `seconds`: from one to the next."""

    def __init__(self, start: Start, send: Send) -> None:
        self._start, self._send = start, send
        self._chosen = start.settings
        self._walkers: list[Walker] = []
        self._learned = "zero" if start.learns else SHIPPED
        self.is_paused, self.speed = False, 1.0
        self._wants_reset = False
        self.reset()

    @property
    def is_moving(self) -> bool:
        """Ticks are due."""
        return not self.is_paused and (self._after_end == 0 or self._chosen.again != "wait")

    @property
    def has_ended(self) -> bool:
        """Nobody walks any more."""
        return self._after_end > 0

    @property
    def seconds(self) -> float:
        """From one tick to the next."""
        return TICK_SECONDS / self.speed

    def reset(self) -> None:
        """Begin again with what is chosen; raises one of `UNUSABLE` where that cannot walk, and nothing changes."""
        settings = self._chosen
        plant = plant_of(self._start.plant, settings)
        names = [name for name in (settings.first, settings.second) if name != NOBODY]
        base, seed = self._start.controller, settings.seed
        walkers = [Walker(name, plant, base, seed, self._learned) for name in names]
        self.close()
        self._walkers, self._settings = walkers, settings
        self._tick = self._after_end = 0
        self._rows: list[float] = []
        about = {
            "mode": "play",
            "title": f"course {settings.seed}",
            "stones": plant.stones,
            "tick_seconds": TICK_SECONDS,
            "walkers": [walker.about for walker in self._walkers],
            "controls": controls(),
            "learns": self._start.learns,
        }
        self._send(b"A" + json.dumps(about).encode())
        self._say_state()

    def close(self) -> None:
        """Give back the plants."""
        for walker in self._walkers:
            walker.close()

    def take(self, message: bytes) -> None:
        """Do what the server passes on; it has checked it."""
        if message.startswith(LOAD):
            self._load(message.removeprefix(LOAD).decode())
        else:
            self._do(ASKED.validate_json(message))
            self._say_state()

    def tick(self) -> None:
        """Go on one tick, or to the next episode."""
        if self._after_end > AGAIN_TICKS:
            self._wants_reset = True
            if self._chosen.again == "next course":
                self._chosen = self._changed(seed=(self._chosen.seed + 1) % 2**31)
        if self._wants_reset:
            self._try_reset()
        if self._after_end:
            self._after_end += 1
            return
        for push in self._settings.pushes:
            if push.tick == self._tick:
                self._push(push)
        walking = [walker for walker in self._walkers if not walker.outcome]
        for walker in walking:
            walker.tick()
        self._rows += [number for walker in self._walkers for number in walker.row]
        self._tick += 1
        if any(walker.outcome for walker in walking):
            self._say_ended()
        if self._tick % SENT_TICKS == 0 or self.is_paused or self._after_end:
            self.flush()

    def flush(self) -> None:
        """Send the rows that wait."""
        if self._rows:
            self._send(b"R" + struct.pack(f"<{len(self._rows)}f", *self._rows))
            self._rows = []

    def say(self, kind: str, word: dict[str, Any]) -> None:
        """Send a word."""
        self._send(b"W" + json.dumps([kind, word]).encode())

    def _do(self, asked: Asked) -> None:
        match asked:
            case Set():
                self._set(asked.settings)
                self._wants_reset |= asked.reset
            case Reset():
                self._chosen = self._changed(pushes=())
                self._wants_reset = True
            case Pause():
                self.is_paused = asked.paused
            case Tick():
                self.is_paused = True
                self.tick()
            case Speed():
                self.speed = asked.speed
            case PushNow():
                self._push_now(Push(tick=self._tick, force=asked.force, seconds=asked.seconds))
        if self._wants_reset and not self.is_moving:
            self._try_reset()
        self.flush()

    def _try_reset(self) -> None:
        self._wants_reset = False
        try:
            self.reset()
        except UNUSABLE as error:
            self._chosen = self._settings
            self.say("note", {"text": " ".join(str(error).split())})
            self._say_state()

    def _set(self, settings: PlaySettings) -> None:
        self._chosen = settings
        at_once = PlaySettings.model_fields.keys() - {"first", "second", "pushes", *COURSE}
        in_force = {name: getattr(settings, name) for name in at_once}
        for field, walker in zip(("first", "second"), self._walkers, strict=False):
            name = getattr(settings, field)
            if name != NOBODY and walker.become(name):
                in_force[field] = name
        before, self._settings = self._settings, self._settings.model_copy(update=in_force)
        plants = [plant_of(self._start.plant, each) for each in (before, self._settings)]
        if plants[0] != plants[1]:
            for walker in self._walkers:
                walker.change(plants[1])

    def _push_now(self, push: Push) -> None:
        if self._after_end or len(self._settings.pushes) == MOST_PUSHES:
            return
        pushes = (*self._settings.pushes, push)
        self._settings, self._chosen = (s.model_copy(update={"pushes": pushes}) for s in (self._settings, self._chosen))

    def _push(self, push: Push) -> None:
        for walker in self._walkers:
            walker.push(push.force, push.seconds)

    def _load(self, path: str) -> None:
        """Walk on with what was learned."""
        self._learned = path
        for walker in self._walkers:
            walker.learned = path
            if walker.name == "learned" and walker.become("learned"):
                self.say("swap", {"tick": self._tick, "version": walker.policy_version})

    def _changed(self, **changes: Any) -> PlaySettings:
        return self._chosen.model_copy(update=changes)

    def _say_state(self) -> None:
        chosen, in_force = (settings.model_dump(mode="json") for settings in (self._chosen, self._settings))
        waiting = [name for name in chosen if chosen[name] != in_force[name] and name != "pushes"]
        self.say("state", {"settings": chosen, "waiting": waiting, "paused": self.is_paused, "speed": self.speed})

    def _say_ended(self) -> None:
        ended = [{"outcome": walker.outcome, "stones": walker.stones} for walker in self._walkers]
        self.say("ended", {"walkers": ended})
        self._after_end = int(all(walker.outcome for walker in self._walkers))


def play(connection: Connection, start: Start) -> None:
    """Play until the other end closes: raises `EOFError` or `ConnectionError` then."""
    try:
        player = Player(start, connection.send_bytes)
    except UNUSABLE as error:
        option = f"--{error.option} " if isinstance(error, AssemblyError) else ""
        connection.send_bytes(b"E" + f"{option}{error}".encode())
        return
    with closing(player):
        _play(connection, player)


def _play(connection: Connection, player: Player) -> None:
    due = time.monotonic()
    pace = (due, 0)
    while True:
        wait = max(due - time.monotonic(), 0) if player.is_moving else None
        while connection.poll(wait):
            player.take(connection.recv_bytes())
            wait = 0
        now = time.monotonic()
        if not player.is_moving or now - due > BEHIND:
            due, pace = now, (now, 0)
        if player.is_moving and now >= due:
            player.tick()
            due += player.seconds
            pace = _measured(pace, player)


def _measured(pace: tuple[float, int], player: Player) -> tuple[float, int]:
    """Say the pace once in a while: simulated seconds a second, over what it should be."""
    began, ticks = pace[0], pace[1] + 1
    if ticks < PACE_TICKS:
        return began, ticks
    now = time.monotonic()
    player.say("pace", {"pace": ticks * player.seconds / (now - began)})
    return now, 0
