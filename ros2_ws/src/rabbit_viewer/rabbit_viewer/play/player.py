"""Plays a walk: the robots on one course, in real time, as a person asks. Runs in a process of its own.

It takes a message between two ticks, more if there is time: so the walk goes on, however much is asked.
"""

import queue
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from multiprocessing.queues import Queue
from typing import Any

from pydantic import ValidationError
from rabbit_description.gait import GaitError
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import AssemblyError
from rabbit_sim.stones import CourseError
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_viewer.page.rows import packed
from rabbit_viewer.play.messages import Asked, Begin, Learned, Pause, PushNow, Reset, Set, Speed, Tick
from rabbit_viewer.play.settings import (
    MOST_DEEDS,
    NOBODY,
    PLANT_AT_ONCE,
    ROBOTS,
    SHIPPED,
    PlayError,
    PlaySettings,
    Push,
    Script,
    Start,
    controls,
    plant_of,
)
from rabbit_viewer.play.walker import Walker

STATE_SECONDS = 0.03  # from one look at whether the state has changed to the next
BEHIND = 0.25  # s, after which lost time is not caught up with
PACE_TICKS = 100  # over which the pace is measured
AGAIN_TICKS = 200  # after the end, before the next episode
UNUSABLE = (GaitError, CourseError, PolicyFileError, AssemblyError)
Send = Callable[..., None]


class Player:
    """`is_moving`: whether ticks are due; `seconds`: from one to the next. `send`: see `serving.tell`."""

    def __init__(self, start: Start, send: Send) -> None:
        """Raises `PlayError`."""
        self._start, self._send = start, send
        self._chosen = start.settings
        self._walkers: list[Walker] = []
        self._has_changed = False  # the state, since it was sent
        self._learned = "zero" if start.learns else SHIPPED
        self.is_paused, self.speed = False, 1.0
        self._next: Script | None = None  # wanted; its settings are those chosen
        try:
            self.reset(Script(settings=start.settings))
        except UNUSABLE as error:
            option = f"--{error.option} " if isinstance(error, AssemblyError) else ""
            raise PlayError(f"{option}{error}") from error

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

    def reset(self, script: Script) -> None:
        """Begin again; raises one of `UNUSABLE` where that cannot walk, and nothing changes."""
        settings = script.settings
        plant = plant_of(self._start.plant, settings)
        names = [name for name in (settings.first, settings.second) if name != NOBODY]
        base, seed = self._start.controller, settings.seed
        walkers = [Walker(name, plant, base, seed, self._learned) for name in names]
        self.close()
        self._walkers, self._settings, self._script = walkers, settings, script
        self._tick = self._after_end = 0
        about = {
            "mode": "play",
            "title": f"course {settings.seed}",
            "stones": plant.stones,
            "tick_seconds": TICK_SECONDS,
            "walkers": [walker.about for walker in self._walkers],
            "controls": controls(),
            "learns": self._start.learns,
            "options": self._start.options,
        }
        self._send("begin", about)
        self._has_changed = True

    def close(self) -> None:
        """Give back the plants."""
        for walker in self._walkers:
            walker.close()

    def take(self, asked: Asked | Learned) -> None:
        """Do what the server passes on; it has checked it."""
        match asked:
            case Learned():
                self._load(asked.path)
                return
            case Set():
                self._set(asked.settings)
            case Reset():
                self._next = Script(settings=self._chosen)
            case Begin():
                self._chosen, self._next = asked.script.settings, asked.script
            case Pause():
                self.is_paused = asked.paused
            case Tick():
                self.is_paused = True
                self.tick()
            case Speed():
                self.speed = asked.speed
            case PushNow():
                self._push_now(Push(tick=self._tick, force=asked.force, seconds=asked.seconds))
        if self._next and not self.is_moving:
            self._try_reset(self._next)
        self._has_changed = True

    def tick(self) -> None:
        """Go on one tick, or to the next episode."""
        if self._after_end > AGAIN_TICKS:
            if self._chosen.again == "next course":
                self._chosen = self._chosen.model_copy(update={"seed": (self._chosen.seed + 1) % 2**31})
            self._next = Script(settings=self._chosen)
        if self._next:
            self._try_reset(self._next)
        if self._after_end:
            self._after_end += 1
            return
        self._do_what_the_script_says()
        walking = [walker for walker in self._walkers if not walker.outcome]
        for walker in walking:
            walker.tick()
        self._send("add", packed([number for walker in self._walkers for number in walker.row]))
        self._tick += 1
        if any(walker.outcome for walker in walking):
            self._say_ended()

    def say_state(self) -> None:
        """Say how everything stands, if that has changed."""
        if self._has_changed:
            self._has_changed = False
            self.say("state", self._state())

    def say(self, kind: str, word: dict[str, Any]) -> None:
        """A word for all who watch."""
        self._send("say", kind, word)

    def _try_reset(self, script: Script) -> None:
        self._next = None
        try:
            self.reset(script.model_copy(update={"settings": self._chosen}))
        except UNUSABLE as error:
            self._chosen = self._settings
            self.say("note", {"text": " ".join(str(error).split())})
            self._has_changed = True

    def _set(self, settings: PlaySettings) -> None:
        """What acts at once becomes part of the script, so that the link is this walk."""
        changes = self._act_at_once(settings)
        try:
            script = self._script if self._after_end else self._script.with_changes(self._tick, changes)
        except ValidationError:
            self.say("note", {"text": f"{MOST_DEEDS} changes are the most of one walk: reset first"})
            return
        again = {"again": settings.again}  # the walk is the same
        self._script = script.model_copy(update={"settings": script.settings.model_copy(update=again)})
        self._chosen, self._settings = settings, self._settings.model_copy(update=again)
        self._change(changes)

    def _act_at_once(self, settings: PlaySettings) -> dict[str, Any]:
        """What of `settings` is not yet in force, and needs no reset."""
        robots = [name for name, walker in self._robots() if walker.may_become(getattr(settings, name))]
        wanted = {name: getattr(settings, name) for name in (*robots, *PLANT_AT_ONCE)}
        return {name: value for name, value in wanted.items() if value != getattr(self._settings, name)}

    def _change(self, changes: dict[str, Any]) -> None:
        for name, walker in self._robots():
            if name in changes:
                walker.become(changes[name])
        self._settings = self._settings.model_copy(update=changes)
        if changes.keys() - set(ROBOTS):
            for walker in self._walkers:
                walker.change(plant_of(self._start.plant, self._settings))

    def _robots(self) -> Iterator[tuple[str, Walker]]:
        return zip(ROBOTS, self._walkers, strict=False)

    def _push_now(self, push: Push) -> None:
        if self._after_end:
            return
        try:
            self._script = self._script.with_push(push)
        except ValidationError:
            self.say("note", {"text": f"{MOST_DEEDS} pushes are the most of one walk: reset first"})

    def _do_what_the_script_says(self) -> None:
        """At this tick. What a person changed before it is in force already."""
        changes = self._act_at_once(self._settings.model_copy(update=self._script.changed_at(self._tick)))
        if changes:
            self._chosen = self._chosen.model_copy(update=changes)
            self._change(changes)
            self._has_changed = True
        for push in self._script.pushes:
            if push.tick == self._tick:
                for walker in self._walkers:
                    walker.push(push.force, push.seconds)

    def _load(self, path: str) -> None:
        """Walk on with what was learned."""
        self._learned = path
        for walker in self._walkers:
            walker.learned = path
            if walker.name == "learned":
                walker.become("learned")
                self.say("swap", {"tick": self._tick, "version": walker.policy_version})

    def _state(self) -> dict[str, Any]:
        chosen, in_force = (settings.model_dump(mode="json") for settings in (self._chosen, self._settings))
        waiting = [name for name in chosen if chosen[name] != in_force[name]]
        script = self._script.model_dump(mode="json")
        word = {"settings": chosen, "waiting": waiting, "paused": self.is_paused, "speed": self.speed}
        return {**word, "script": script}

    def _say_ended(self) -> None:
        ended = [{"outcome": walker.outcome, "stones": walker.stones} for walker in self._walkers]
        self.say("ended", {"walkers": ended})
        self._after_end = int(all(walker.outcome for walker in self._walkers))


def play(send: Send, start: Start, wishes: "Queue[Asked | Learned]") -> None:
    """Play until the process ends."""
    try:
        player = Player(start, send)
    except PlayError as error:
        send("fail", str(error))
        return
    with closing(player):
        _play(player, wishes)


def _play(player: Player, wishes: "Queue[Asked | Learned]") -> None:
    now = due = shown = time.monotonic()
    pace = (due, 0)
    while True:
        until = min(due, shown) if player.is_moving else shown
        with suppress(queue.Empty):
            player.take(wishes.get(timeout=max(until - now, 0)))
        now = time.monotonic()
        if not player.is_moving or now - due > BEHIND:
            due, pace = now, (now, 0)
        if player.is_moving and now >= due:
            player.tick()
            due += player.seconds
            pace = _measured(pace, player)
        if now >= shown:
            player.say_state()
            shown = now + STATE_SECONDS


def _measured(pace: tuple[float, int], player: Player) -> tuple[float, int]:
    """Say the pace once in a while: simulated seconds a second, over what it should be."""
    began, ticks = pace[0], pace[1] + 1
    if ticks < PACE_TICKS:
        return began, ticks
    now = time.monotonic()
    player.say("pace", {"pace": ticks * player.seconds / (now - began)})
    return now, 0
