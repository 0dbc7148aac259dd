"""Plays a walk: the robots on one course. Runs in a process without the page."""

from typing import Any

from rabbit_description.gait import GaitError
from rabbit_experiments.assembly import AssemblyError
from rabbit_sim.stones import CourseError
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_viewer.play import playing
from rabbit_viewer.play.messages import Learned
from rabbit_viewer.play.settings import (
    NOBODY,
    PLANT_AT_ONCE,
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


class Player(playing.Playing):
    """Plays a walk, see `Playing`."""

    unusable = (GaitError, CourseError, PolicyFileError, AssemblyError)
    model = PlaySettings
    walkers: list[Walker]

    def __init__(self, start: Start, send: playing.Send) -> None:
        """Raises `PlayError`."""
        self._start, self.tick_seconds = start, start.plant.tick_seconds
        self._learned = "zero" if start.learns else SHIPPED
        try:
            super().__init__(start.settings, send)
        except self.unusable as error:
            option = f"--{error.option} " if isinstance(error, AssemblyError) else ""
            raise PlayError(f"{option}{error}") from error

    def make_walkers(self, settings: PlaySettings) -> tuple[list[Walker], dict[str, Any]]:
        plant = plant_of(self._start.plant, settings)
        names = [name for name in (settings.first, settings.second) if name != NOBODY]
        walkers = [Walker(name, self._start, plant, settings.seed, self._learned) for name in names]
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

    @property
    def robots(self) -> dict[str, Walker]:
        """The walkers by the setting that chose them."""
        return dict(zip(ROBOTS, self.walkers, strict=False))

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
