"""`rabbit play --task`: a task rides again and again on the page, one controller beside another, as a person asks.

The plant's true parameters act at once. From the next ride on act the controllers, `pace`, how fast the commands go by,
and for each commanded parameter what is added to it; a parameter that is another one's rate follows the pace.
"""

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import casadi as ca
from pydantic import Field, create_model
from rabbit_description.task import ControlTask, Given, TaskError
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.task_source import load_task
from rabbit_description.user_code import fault_in_user_code
from rabbit_description.validation import Checked
from rabbit_recording.explaining import explain_ride
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.rollout import Record
from rl_trainer.task_episode import Ride, moment_of

from rabbit_viewer.page.ride import RideRows, ended_of, numbers_of, pictured
from rabbit_viewer.play import playing
from rabbit_viewer.play.messages import Asked, Choose, Push
from rabbit_viewer.play.settings import NOBODY, Number, PlayError, described, shown

ROOM = 2  # times what the first picture takes: later ones may have more shapes
TRUE, ADDED = "true_", "added_"  # before a parameter's name, of settings
WAITS = "When a ride has ended, you read here which barriers it kept."


@dataclass(frozen=True)
class Start:
    """Which task is played, from its file or entry point, under which controllers, and the first seed."""

    source: str
    controllers: tuple[str, ...]
    seed: int


def check_asked(settings: type[Checked], asked: Asked) -> None:
    """Whether it can be asked of a task with such `settings`; raises `ValidationError`, `PlayError`."""
    if isinstance(asked, Choose):
        settings.model_validate(asked.settings)
    if isinstance(asked, Push):
        raise PlayError("push: expected a walk of RABBIT")


def settings_of(task: ControlTask, start: Start) -> type[Checked]:
    """What can be chosen: controllers, the plant's parameters, changes of what is commanded."""
    names, when = start.controllers, {"when": "reset"}
    second: Any = names[1] if names[1:] else NOBODY
    fields: dict[str, Any] = {
        "first": (Literal[names], Field(names[0], title="controller", json_schema_extra=dict(when))),
        "second": (Literal[(*names, NOBODY)], Field(second, title="beside it", json_schema_extra=dict(when))),
    }
    for name, believed in task.nominal.items():
        true = task.true.get(name, believed)
        title = f"true {name}; the model has {believed:g}"
        fields[TRUE + name] = (Number, shown(true, *bounds(true, believed), title, step(true, believed)))
    commanded = task.beginning(start.seed)[1](0.0, 0)
    rates = rates_of(task)
    for name in (name for name in commanded if name not in (rates or ())):
        most = abs(commanded[name]) or 1.0
        bound = (-math.ceil(most / step(most)) * step(most), math.ceil(most / step(most)) * step(most))
        fields[ADDED + name] = (Number, shown(0.0, *bound, f"{name}: more", step(most), when="reset"))
    if commanded and rates is not None:
        fields["pace"] = (Number, shown(1.0, 0, 3, "pace of the commands", 0.05, "x", "reset"))
    again = Field("next course", title="at the end", json_schema_extra={"when": "now"})
    fields["seed"] = (int, shown(start.seed, 0, 2**31 - 1, "seed", when="reset"))
    fields["again"] = (Literal["wait", "same course", "next course"], again)
    return create_model("TaskSettings", __base__=Checked, **fields)


def step(*values: float) -> float:
    """The step of a slider for such values: a power of ten."""
    most = max(abs(value) for value in values) or 1.0
    return float(f"{10.0 ** math.floor(math.log10(most / 20)):.0e}")


def bounds(true: float, believed: float) -> tuple[float, float]:
    """The bounds of the plant's parameter: of one sign, if both are; a positive one stays positive."""
    by, most, least = step(true, believed), 2.5 * max(abs(true), abs(believed), 0.4), min(true, believed)
    low = max(0.25 * least, by) if least > 0 else 0.0 if least == 0 else -most
    return math.floor(low / by + 1e-9) * by, math.ceil(most / by) * by


def rates_of(task: ControlTask) -> set[str] | None:
    """Commanded parameters that are another one's rate; None where a rate is a further expression."""
    named, rates = task.system.named, [ca.SX(rate) for rate in task.system.rates.values()]
    names = {name for name in task.commanded if any(ca.is_equal(named[name], rate) for rate in rates)}
    return names if all(any(ca.is_equal(named[name], rate) for name in names) for rate in rates) else None


def altered(task: ControlTask, settings: Any, commands: Given) -> Given:
    """What is commanded and announced under the settings."""
    rates, chosen = rates_of(task) or set(), settings.model_dump()
    pace = chosen.get("pace", 1.0)

    def at(t: float, impacts: int) -> dict[str, float]:
        values = commands(pace * t, impacts).items()
        return {name: pace * v if name in rates else v + chosen.get(ADDED + name, 0.0) for name, v in values}

    return at


class PlayedRide:
    """A ride, tick by tick; see `playing.Shown`. A task is a user's code: whatever it raises ends its ride."""

    def __init__(self, task: ControlTask, name: str, rows: RideRows, settings: Any) -> None:
        """Raises `TaskError`."""
        self.simulation, self.controller = TaskSimulation(task), TaskController(task)
        self.simulation.altered = partial(altered, task, settings)
        self.controller.policy = self.controller.controlling(name)
        self.name, self._rows, self._has_qp = Path(name).stem, rows, name not in self.controller.brought
        self._ride = Ride(task, self.name, settings.seed)
        self.row, self.outcome = [math.nan] * len(rows.columns), ""

    @property
    def about(self) -> dict[str, Any]:
        """What the page needs to draw its rows."""
        return self._rows.about(self.name, self.name, self._has_qp)

    @property
    def ended(self) -> dict[str, Any]:
        """How it ended, if it has."""
        return ended_of(self._ride) if self.outcome else {"outcome": "", "stones": self._ride.impacts}

    def tick(self) -> None:
        """Go on one tick; the last row comes twice."""
        ride, moments = self._ride, self._ride.moments
        try:
            if moments:
                state = self.simulation.step(moments[-1].u)
            else:
                state = self.simulation.reset(ride.seed)
                self.controller.reset(ride.seed)
            if state.running:
                moment = moment_of(self.controller, Record(state, self.controller.step(state)))
                self.row, ride.impacts = self._rows.row(len(moments), moment), state.touchdowns
                moments.append(moment)
                if not moment.output.fault:
                    return
            ride.end(self.simulation, state)
        except Exception as error:
            self._ride.outcome = fault_in_user_code(error) or " ".join(f"{type(error).__name__}: {error}".split())
        self.outcome = self._ride.outcome

    def explain(self, tick: int) -> list[str]:
        """Explains a tick in words; raises ValueError."""
        return explain_ride(self._ride, tick).lines()


class TaskPlayer(playing.Playing):
    """Plays a task, see `Playing`."""

    unusable = (TaskError,)

    def __init__(self, start: Start, send: playing.Send) -> None:
        """Raises `PlayError`."""
        self._start, task = start, load_task(start.source)
        self._tasks = task, replace(task)  # whose ticks are different objects
        self.tick_seconds = task.seconds
        self.model = settings_of(task, start)
        self._rides: list[PlayedRide] = []
        try:
            x, commands, _ = task.beginning(start.seed)
            most = ROOM * len(numbers_of(pictured(task, x, task.parameters_at({}, commands(0.0, 0)))))
            self._rows = [RideRows(task, most) for task in self._tasks]
            super().__init__(self.model(), send)
        except TaskError as error:
            raise PlayError(str(error)) from error

    def make_walkers(self, settings: Any) -> tuple[list[PlayedRide], dict[str, Any]]:
        names = [name for name in (settings.first, settings.second) if name != NOBODY]
        played = zip(self._tasks, names, self._rows, strict=False)
        self._rides = rides = [PlayedRide(task, name, rows, settings) for task, name, rows in played]
        self._change(settings)
        about = {
            "title": f"{self._tasks[0].name}, seed {settings.seed}",
            "controls": described(self.model),
            "story": self._opening(settings),
            "waits": WAITS,
            "next": [{"text": "Why then?", "do": {"do": "explain"}}],
            "options": "",
        }
        return rides, about

    def set(self, settings: Any) -> None:
        self._chosen = settings
        now = {name: value for name, value in settings.model_dump().items() if name.startswith(TRUE)}
        self._settings = self._settings.model_copy(update={**now, "again": settings.again})
        self._change(settings)

    def _change(self, settings: Any) -> None:
        """The plants."""
        true = {name: getattr(settings, TRUE + name) for name in self._tasks[0].nominal}
        for ride in self._rides:
            ride.simulation.true.update(true)
            ride.controller.true.update(true)

    def _opening(self, settings: Any) -> str:
        """One sentence: what the model gets wrong."""
        nominal = self._tasks[0].nominal.items()
        told = [f"{name} {getattr(settings, TRUE + name):g} (model: {believed:g})" for name, believed in nominal]
        return f"The true system has {', '.join(told)}." if told else "The model is the true system."
