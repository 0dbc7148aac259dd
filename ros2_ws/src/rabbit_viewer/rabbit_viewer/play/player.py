"""Plays a walk: the robots on one course, in real time, as a person asks. Runs in a process of its own.

It takes a message between two ticks, more if there is time: so the walk goes on, however much is asked.
"""

import queue
import time
from collections.abc import Callable
from contextlib import closing, suppress
from multiprocessing.queues import Queue
from typing import Any

from rabbit_description.gait import GaitError
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import AssemblyError
from rabbit_experiments.walk_records import RecordsError
from rabbit_recording import RecordingError
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.stones import CourseError
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_viewer.page.messages import Explain
from rabbit_viewer.page.rows import packed
from rabbit_viewer.play.messages import Asked, Begin, Learned, Pause, Push, Reset, Set, Speed, Tick
from rabbit_viewer.play.recorded_walker import RecordedWalker
from rabbit_viewer.play.settings import (
    NOBODY,
    PLANT_AT_ONCE,
    RECORDED,
    ROBOTS,
    SHIPPED,
    PlayError,
    PlaySettings,
    Start,
    controls,
    plant_of,
)
from rabbit_viewer.play.story import next_things, opening
from rabbit_viewer.play.walker import Walker

STATE_SECONDS = 0.03  # from one look at whether the state has changed to the next
BEHIND = 0.25  # s, after which lost time is not caught up with
AGAIN_TICKS = 200  # after the end, before the next episode
UNUSABLE = (GaitError, CourseError, PolicyFileError, AssemblyError, RecordsError, RecordingError)
Send = Callable[..., None]


class Player:
    """`walkers`: the robots; `is_moving`: whether ticks are due; `seconds`: from one to the next.

    `send`: see `serving.tell`.
    """

    def __init__(self, start: Start, send: Send) -> None:
        """Raises `PlayError`."""
        self._start, self._send = start, send
        self._chosen = start.settings
        self.walkers: list[Walker | RecordedWalker] = []
        self._learned = "zero" if start.learns else SHIPPED
        self.is_paused, self.speed = False, 1.0
        self._is_awaiting = True  # its first viewer
        self._has_changed = False  # the state, since it was sent
        self._is_reset_due = False
        try:
            self.reset()
        except UNUSABLE as error:
            option = f"--{error.option} " if isinstance(error, AssemblyError) else ""
            raise PlayError(f"{option}{error}") from error

    @property
    def is_moving(self) -> bool:
        """Ticks are due."""
        return not (self.is_paused or self._is_awaiting) and (self._after_end == 0 or self._chosen.again != "wait")

    @property
    def has_ended(self) -> bool:
        """Nobody walks any more."""
        return self._after_end > 0

    @property
    def seconds(self) -> float:
        """From one tick to the next."""
        return TICK_SECONDS / self.speed

    def reset(self) -> None:
        """Begin again as chosen; raises one of `UNUSABLE` where that cannot walk, and nothing changes."""
        settings = self._chosen
        plant = plant_of(self._start.plant, settings)
        names = [name for name in (settings.first, settings.second) if name != NOBODY]
        walkers = [self._walker(name, plant, settings.seed) for name in names]
        self.close()
        self.walkers, self._settings = walkers, settings
        self._tick = self._after_end = 0
        about = {
            "mode": "play",
            "title": f"course {settings.seed}",
            "stones": plant.stones,
            "tick_seconds": TICK_SECONDS,
            "walkers": [walker.about for walker in self.walkers],
            "controls": controls(self._start),
            "story": opening(self._start, settings),
            "next": next_things(settings),
            "learns": self._start.learns,
            "explains": True,
            "options": self._start.options,
        }
        self._send("begin", about)
        self._has_changed = True

    def _walker(self, name: str, plant: SimulationParameters, seed: int) -> Walker | RecordedWalker:
        if name == RECORDED and self._start.recording:
            return RecordedWalker(self._start.recording)
        return Walker(name, self._start, plant, seed, self._learned)

    @property
    def robots(self) -> dict[str, Walker]:
        """Those that are simulated, by the setting that chose them: not what was recorded."""
        return {name: each for name, each in zip(ROBOTS, self.walkers, strict=False) if isinstance(each, Walker)}

    def close(self) -> None:
        """Give back the plants."""
        for robot in self.robots.values():
            robot.close()

    def take(self, asked: Asked | Learned) -> None:
        """Do what the server passes on; it has checked it."""
        self._is_awaiting &= isinstance(asked, Learned | Explain)
        match asked:
            case Learned():
                self._load(asked.path)
            case Explain():
                self._explain(asked)
            case Set():
                self._set(asked.settings)
            case Reset():
                self._is_reset_due = True
            case Begin():
                self._chosen, self._is_reset_due = asked.settings, True
            case Pause():
                self.is_paused = asked.paused
            case Tick():
                self.is_paused = True
                self.tick()
            case Speed():
                self.speed = asked.speed
            case Push():
                for robot in self.robots.values():
                    robot.push(asked.force, asked.seconds)
        if self._is_reset_due and not self.is_moving:
            self._try_reset()
            self.tick()  # so that the robots are seen
        self._has_changed = True

    def tick(self) -> None:
        """Go on one tick, or to the next episode."""
        if self._after_end > AGAIN_TICKS:
            if self._chosen.again == "next course":
                self._chosen = self._chosen.model_copy(update={"seed": (self._chosen.seed + 1) % 2**31})
            self._is_reset_due = True
        if self._is_reset_due:
            self._try_reset()
        if self._after_end:
            self._after_end += 1
            return
        walking = [walker for walker in self.walkers if not walker.outcome]
        for walker in walking:
            walker.tick()
        self._send("add", packed([number for walker in self.walkers for number in walker.row]))
        self._tick += 1
        if any(walker.outcome for walker in walking):
            self.say("ended", {"walkers": [walker.ended for walker in self.walkers]})
            self._after_end = int(all(walker.outcome for walker in self.walkers))

    def say_state(self) -> None:
        """Say how everything stands, if that has changed."""
        if self._has_changed:
            self._has_changed = False
            chosen, in_force = (settings.model_dump(mode="json") for settings in (self._chosen, self._settings))
            waiting = [name for name in chosen if chosen[name] != in_force[name]]
            self.say("state", {"settings": chosen, "waiting": waiting, "paused": self.is_paused, "speed": self.speed})

    def say(self, kind: str, word: dict[str, Any]) -> None:
        """A word for all who watch."""
        self._send("say", kind, word)

    def _try_reset(self) -> None:
        self._is_reset_due = False
        try:
            self.reset()
        except UNUSABLE as error:
            self._chosen = self._settings
            self.say("note", {"text": " ".join(str(error).split())})
            self._has_changed = True

    def _set(self, settings: PlaySettings) -> None:
        """What needs no reset acts at once."""
        swapped = [name for name, robot in self.robots.items() if robot.may_become(getattr(settings, name))]
        wanted = {name: getattr(settings, name) for name in (*swapped, *PLANT_AT_ONCE)}
        changes = {name: value for name, value in wanted.items() if value != getattr(self._settings, name)}
        self._chosen = settings
        self._settings = self._settings.model_copy(update={**changes, "again": settings.again})
        for name, robot in self.robots.items():
            if name in changes:
                robot.become(changes[name])
            if changes.keys() - set(ROBOTS):
                robot.change(plant_of(self._start.plant, self._settings))

    def _explain(self, asked: Explain) -> None:
        try:
            lines = self.walkers[asked.walker].explain(asked.tick)
        except (IndexError, ValueError) as error:
            lines = [str(error)]
        self.say("explained", {"walker": asked.walker, "tick": asked.tick, "lines": lines})

    def _load(self, path: str) -> None:
        """Walk on with what was learned."""
        self._learned = path
        for robot in self.robots.values():
            robot.learned = path
            if robot.name == "learned":
                self.say("swap", {"tick": self._tick, "version": robot.become("learned")})


def play(send: Send, start: Start, wishes: "Queue[Asked | Learned]") -> None:
    """Play until the process ends."""
    try:
        player = Player(start, send)
    except PlayError as error:
        send("fail", str(error))
        return
    now = due = shown = time.monotonic()
    with closing(player):
        player.tick()  # so that the robots are seen
        while True:
            until = min(due, shown) if player.is_moving else shown
            with suppress(queue.Empty):
                player.take(wishes.get(timeout=max(until - now, 0)))
            now = time.monotonic()
            if not player.is_moving or now - due > BEHIND:
                due = now
            if player.is_moving and now >= due:
                player.tick()
                due += player.seconds
            if now >= shown:
                player.say_state()
                shown = now + STATE_SECONDS
