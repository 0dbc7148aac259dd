"""Plays a walk: the robots on one course, and a recording beside them. Runs in a process without the page."""

from functools import cache
from pathlib import Path
from typing import Any

from rabbit_description.gait import GaitError
from rabbit_experiments.assembly import AssemblyError
from rabbit_experiments.walk_records import RecordsError, WalkRecords
from rabbit_recording import RecordingError
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.stones import CourseError
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_viewer.limp_fall import with_fall
from rabbit_viewer.page.recording import Recorded, recorded
from rabbit_viewer.play import playing
from rabbit_viewer.play.messages import Learned
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
from rabbit_viewer.walk_pictures import records_of


class RecordedWalker:
    """What a `Player` shows of a `Walker`; nothing changes it."""

    def __init__(self, source: Path) -> None:
        """Raises `RecordsError`, `RecordingError`."""
        self._source = source
        self._walk = read(source)
        self.about = {**self._walk.walker, "name": RECORDED, "title": self._walk.title}
        self._next = 0
        self.row: list[float] = []

    @property
    def outcome(self) -> str:
        """Empty while it walks."""
        return str(self._walk.ended["outcome"]) if self._next == len(self._walk.rows) else ""

    @property
    def ended(self) -> dict[str, Any]:
        """As of a `Walker`."""
        return {**self._walk.ended, "outcome": self.outcome}

    @property
    def records(self) -> WalkRecords:
        """All of it and its fall, for a film."""
        return with_fall(records_of(self._source))

    def tick(self) -> None:
        """Go on one tick; nothing, once the recording has ended."""
        if not self.outcome:
            self.row = self._walk.rows[self._next]
            self._next += 1

    def explain(self, tick: int) -> list[str]:
        """What explains a recorded tick."""
        raise ValueError(f"tick {tick} of a recording: `rabbit bag explain RUN/recording --tick {tick}` explains it")


@cache
def read(source: Path) -> Recorded:
    """It is read once, however often it walks."""
    return recorded(records_of(source), source.name)


class Player(playing.Playing):
    """Of a walk, see `Playing`."""

    unusable = (GaitError, CourseError, PolicyFileError, AssemblyError, RecordsError, RecordingError)
    model = PlaySettings
    walkers: list[Walker | RecordedWalker]

    def __init__(self, start: Start, send: playing.Send) -> None:
        """Raises `PlayError`."""
        self._start, self.tick_seconds = start, start.plant.tick_seconds
        self._learned = "zero" if start.learns else SHIPPED
        try:
            super().__init__(start.settings, send)
        except self.unusable as error:
            option = f"--{error.option} " if isinstance(error, AssemblyError) else ""
            raise PlayError(f"{option}{error}") from error

    def make_walkers(self, settings: PlaySettings) -> tuple[list[Walker | RecordedWalker], dict[str, Any]]:
        plant = plant_of(self._start.plant, settings)
        names = [name for name in (settings.first, settings.second) if name != NOBODY]
        walkers = [self._walker(name, plant, settings.seed) for name in names]
        about = {
            "title": f"course {settings.seed}",
            "stones": plant.stones,
            "controls": controls(self._start),
            "story": opening(self._start, settings),
            "next": next_things(settings),
            "learns": self._start.learns,
            "pushes": True,
            "options": self._start.options,
        }
        return walkers, about

    def _walker(self, name: str, plant: SimulationParameters, seed: int) -> Walker | RecordedWalker:
        if name == RECORDED and self._start.recording:
            return RecordedWalker(self._start.recording)
        return Walker(name, self._start, plant, seed, self._learned)

    @property
    def robots(self) -> dict[str, Walker]:
        """Those that are simulated, by the setting that chose them: not what was recorded."""
        pairs = zip(ROBOTS, self.walkers, strict=False)
        return {name: walker for name, walker in pairs if isinstance(walker, Walker)}

    def close(self) -> None:
        """Give back the plants."""
        for robot in self.robots.values():
            robot.close()

    def do(self, asked: Any) -> None:
        """A push, or a policy that was learned."""
        if isinstance(asked, Learned):
            self._load(asked.path)
        elif asked.do == "push":
            for robot in self.robots.values():
                robot.push(asked.force, asked.seconds)

    def set(self, settings: PlaySettings) -> None:
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

    def _load(self, path: str) -> None:
        """Walk on with what was learned."""
        self._learned = path
        for robot in self.robots.values():
            robot.learned = path
            if robot.name == "learned":
                self.say("swap", {"tick": self._tick, "version": robot.become("learned")})
