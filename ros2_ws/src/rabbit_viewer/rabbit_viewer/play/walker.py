"""One robot of a played walk: plant and controller, tick by tick, as rows for the page. It goes limp where it fails.

Of its last ticks it keeps what decided them, so that it can say why it fell, and why any of them was as it was.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import JOINTS, TICK_SECONDS
from rabbit_description.tick import ticks_in
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.walk_records import WalkRecords, about_walk, plant_in_words
from rabbit_recording.explaining import explain_walk
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import Plant, PlantReading
from rabbit_sim.simulation import Outcome
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import ControllerError
from rl_trainer.rollout import Moment, Record

from rabbit_viewer.geometry import torso_points
from rabbit_viewer.page.rows import EVENTS, RowMaker
from rabbit_viewer.play.settings import SHIPPED, SWAPPED_AT_ONCE, YOURS, Start, controller_of
from rabbit_viewer.play.story import title_of, why_it_fell

CLEAR_HEIGHT = 0.01  # m, of a swing foot that is well in the air
NONE = Estimates.zero(1, JOINTS)  # before the oracle nobody has estimated
RUNNING = 1  # column of a row
KEPT_TICKS = 6_000  # a minute: a tick takes some 10 kB
LIMP_SECONDS = 1.5  # at most
LYING = 0.2  # m, of hip or head above the ground
READ = ("q", "dq", "foot_force", "contact")
UNKNOWN = ("V", "clf_slack", "rescue_slack", "barriers", "margins")  # of a tick that no controller decided


class Walker:
    """`name`: of its controller, see `settings.CONTROLLERS`. `row`: the last one. `outcome`: empty while it walks."""

    def __init__(self, name: str, start: Start, plant: SimulationParameters, seed: int, learned: str = SHIPPED) -> None:
        """`learned`: the policy that this name means.

        Raises `GaitError`, `CourseError`, `PolicyFileError`, `AssemblyError`.
        """
        self.name, self._start, self.learned = name, start, learned
        self._terrain = plant.terrain
        parameters, policy = self._choice(name)
        self._assembly = Assembly(plant, parameters, policy)
        self._simulation, self._controller = self._assembly.build()
        qp, about = self._controller.qp, about_walk(parameters, plant, policy, seed, "")
        barriers, rows = self._controller.barrier_names, qp.layout.names
        self._maker = RowMaker(about, qp.names, barriers, knows_plant=True, rows=rows)
        self._oracle = self._make_oracle()
        self._true = np.full(len(qp.names), np.nan)
        self._controller.reset(seed)
        self._state = self._simulation.reset(seed)
        self._output: ControllerOutput
        self._kept: deque[Moment] = deque(maxlen=KEPT_TICKS)
        self._drawn: deque[Record] = deque(maxlen=KEPT_TICKS)
        self._pushed_until = 0
        self._fall: Iterator[PlantReading] | None = None
        self._swapped = False
        self._next_plant: SimulationParameters | None = None
        self.fault = self.outcome = ""
        self.row: list[float] = []

    @property
    def about(self) -> dict[str, Any]:
        """What the page needs to draw its rows."""
        return {**self._maker.about(self.name), "title": title_of(self.name, self._start)}

    @property
    def ended(self) -> dict[str, Any]:
        """How it ended, for the page: outcome, empty while it walks; stones walked so far; why it fell, if it did."""
        seconds = self._assembly.simulation.tick_seconds
        fell = self.outcome not in ("", Outcome.WALKED.value)
        why = why_it_fell(self.name, self.outcome, list(self._kept), self._simulation.landings, seconds) if fell else {}
        return {"outcome": self.outcome, "stones": self._state.touchdowns, **why}

    @property
    def records(self) -> WalkRecords:
        """The walker's last ticks, which are kept, for a film: how it ended and why in words."""
        why = str(self.ended.get("reason", ""))
        title = f"{self.about['title']}; {plant_in_words(self.about)}"
        about = {**self.about, "title": title, "outcome": self.outcome, "reason": why}
        return WalkRecords.from_ticks(list(self._drawn), self._simulation.landings, about)

    def explain(self, tick: int) -> list[str]:
        """A tick in words; raises `ValueError` where it is not kept, or no solver answered it."""
        near = {kept.output.tick: kept for kept in self._kept if abs(kept.output.tick - tick) <= 1}
        if tick not in near:
            first, last = (self._kept[i].output.tick if self._kept else 0 for i in (0, -1))
            raise ValueError(f"tick {tick} of {self.name}: expected one from {first} to {last}, which are kept")
        programme, seconds = self._controller.qp, self._assembly.simulation.tick_seconds
        return explain_walk(f"robot {self.name}", programme, near, tick, seconds).lines()

    def close(self) -> None:
        """Give back the plant."""
        self._simulation.close()

    def push(self, force: float, seconds: float) -> None:
        """Push the torso; raises `ValueError` where the plant cannot be pushed."""
        if not self.outcome:
            self._simulation.push(force, seconds)
            self._pushed_until = self._state.tick + ticks_in(seconds, self._assembly.simulation.tick_seconds)

    def may_become(self, name: str) -> bool:
        """Whether it can walk on with that controller, or needs a reset."""
        return {name, self.name} <= SWAPPED_AT_ONCE

    def become(self, name: str) -> str:
        """Walk on with another controller, see `may_become`; the version of its policy."""
        parameters, policy = self._choice(name)
        self._assembly = replace(self._assembly, controller=parameters, policy=policy)
        self._controller.policy = self._assembly.make_policy()  # between two ticks
        self.name, self._swapped = name, True
        return self._controller.policy.version

    def change(self, plant: SimulationParameters) -> None:
        """Walk on with another robot, once its swing foot is in the air."""
        self._next_plant = plant

    def tick(self) -> None:
        """Go on one tick; nothing, once the walk has ended."""
        if self.outcome:
            return
        events = EVENTS["pushed"] * (self._state.tick < self._pushed_until) | EVENTS["swapped"] * self._swapped
        self._swapped = False
        if self._next_plant and not self.fault:
            self._change(self._next_plant)
        if not self.fault:
            self._control()
        if self.fault:
            self._go_limp()
        drawn, reading = self._state, self._simulation.reading
        if drawn.sensors:  # the state is an estimate, which drifts over the ground
            drawn = replace(drawn, q=reading.q, dq=reading.dq)
        self._drawn.append(Record(drawn, self._output))
        self.row = self._maker.row(drawn, self._output, events, self._true)
        self.row[RUNNING] = float(not self.fault)
        if self.fault:
            self._sink()
        else:
            self._state = self._simulation.step(self._output.torque)
            if self._simulation.outcome is Outcome.WALKED:
                self.outcome = Outcome.WALKED.value
            elif not self._state.running:
                self.fault = self._simulation.outcome.value
        if self.outcome:
            self.row[RUNNING] = 0.0

    def _control(self) -> None:
        try:
            self._output = self._controller.step(self._state)
            self.fault = self._output.fault
            controller = self._controller
            self._true = self._oracle.estimate(controller.scene, NONE).error(self._output.mu)
            self._kept.append(Moment.of(controller, Record(self._state, self._output)))
        except (ControllerError, np.linalg.LinAlgError) as error:
            self.fault = f"controller error: {error}"

    def _sink(self) -> None:
        """A tick of the plant that nobody judges any more, until the robot lies on the ground."""
        top = self.row[self._maker.columns.index("stone_top")]
        self._fall = self._fall or fall_limp(self._simulation.plant, top, self._assembly.simulation.tick_seconds)
        if (reading := next(self._fall, None)) is None:
            self.outcome = self.fault
            return
        self._simulation.reading = reading
        seen = {name: getattr(reading, name) for name in READ}
        self._state = replace(self._state, tick=self._state.tick + 1, **seen)

    def _go_limp(self) -> None:
        if self._output.torque.any():
            unknown = {name: getattr(self._output, name) * np.nan for name in UNKNOWN}
            self._output = replace(self._output, torque=np.zeros(JOINTS), **unknown)

    def _change(self, plant: SimulationParameters) -> None:
        reading = self._simulation.reading
        if reading.contact.all() or reading.foot_position[:, 1].max() < CLEAR_HEIGHT:
            return
        self._simulation.change(plant)
        self._next_plant = None
        self._assembly = replace(self._assembly, simulation=plant)
        self._oracle = self._make_oracle()
        if self.name == "oracle":  # it knows the robot that it was made for
            self._controller.policy = self._assembly.make_policy()

    def _make_oracle(self) -> Policy:
        """Gives the true error of the nominal model under any controller."""
        return replace(self._assembly, policy="oracle").make_policy()

    def _choice(self, name: str) -> tuple[ControllerParameters, str]:
        if name == YOURS and self._start.yours:
            return self._start.yours.controller, self._start.yours.policy
        parameters, policy = controller_of(self._start.controller, name, self._terrain)
        return parameters, resolve_policy(self.learned if name == "learned" else policy, parameters)


def fall_limp(plant: Plant, top: float, tick_seconds: float = TICK_SECONDS) -> Iterator[PlantReading]:
    """Each tick without torque, until hip or head lies on the ground, whose height is `top`, m."""
    for _ in range(ticks_in(LIMP_SECONDS, tick_seconds)):
        plant.advance(np.zeros(JOINTS))
        reading = plant.observe()
        yield reading
        if not torso_points(reading.q[None])[0, :, 1].min() - top > LYING:
            return
