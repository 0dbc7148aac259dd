"""Episodes of the true plant: what a controller sees, where the feet landed and how it ended. Read this file first."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import ceil, isfinite, pi, sqrt
from pathlib import Path

import numpy as np
from rabbit_description.gait import Gaits
from rabbit_description.plugins import load
from rabbit_description.state import JOINTS, LAYOUT, Array, Leg, RobotState, no_torque

from rabbit_sim.initial_state import initial_state
from rabbit_sim.parameters import PLANTS, SimulationParameters
from rabbit_sim.perturbation import Memory, Perturbation
from rabbit_sim.perturbations.ground import RUBBER_STIFFNESS
from rabbit_sim.plant import GRAVITY, Plant, PlantReading, Span, Touch
from rabbit_sim.robot_urdf import true_mass
from rabbit_sim.stones import CourseError, draw_course, read_course
from rabbit_sim.terrain import Ground, Terrain

FLIGHT_SECONDS = 0.05  # without a foot on the ground; on ground that throws the robot back, longer
SLIP_FRICTION = 0.8  # ground no better than this counts slips
SLIP_DISTANCE = 0.005  # m
STALL_SECONDS = 5.0  # since the last touchdown; a step of any gait takes a tenth of that


class Outcome(Enum):
    """How an episode stands or ended."""

    IDLE = "idle"  # not reset yet
    RUNNING = "running"
    WALKED = "walked"  # all stones
    MISS = "miss"  # the foot came down off its stone, and the episode stops at that
    GAP_FALL = "gap_fall"  # the foot fell into a gap
    FALL = "fall"  # by pose
    SLIP = "slip"
    FLIGHT = "flight"
    STALL = "stall"  # stands, and takes no step
    DIVERGED = "diverged"  # the plant's numbers are not finite


@dataclass(frozen=True)
class Landing:
    """Stone `index` was stepped at in `tick`: `l`, true, m from the stance foot; the stone's edges, NaN on flat ground.

    The edges count from where the stance foot is now, which may have slid since it saw them. `on_stone` is False where
    the foot found no hold.
    """

    index: int
    tick: int
    l: float  # noqa: E741, the paper's l_k
    l_min: float
    l_max: float
    on_stone: bool

    @property
    def missed(self) -> bool:
        """Outside [l_min, l_max], whether or not there was a hold."""
        return self.l < self.l_min or self.l > self.l_max


class Simulation:
    """One robot on one course at a time.

    `course`: the stones; `outcome`, `landings`: how the episode stands. `plant`: the robot on the ground. `reading`:
    the truth after the last tick, for judges alone.
    Example: `state = simulation.reset(seed=1)`, then `state = simulation.step(torque)` while `state.running`.
    """

    layout = LAYOUT

    def __init__(
        self, parameters: SimulationParameters, gait: Gaits, estimate: Callable[[RobotState], RobotState] | None = None
    ) -> None:
        """`estimate`: a state estimator that sees every state in turn, between sensors and controller.

        Raises:
            CourseError: the course file cannot be used.
        """
        self.parameters = parameters
        self._estimate = estimate
        self._gait = gait
        course = parameters.course
        self._file_course = read_course(Path(course), parameters.stones, parameters.stone_width) if course else None
        if parameters.plant == "rigid" and any(stone.height for stone in self._file_course or ()):
            raise CourseError(f"course {course}: a stone with a height, plant rigid: expected pybullet or mujoco")
        self.plant: Plant = load(PLANTS, parameters.plant)(parameters)
        self.outcome = Outcome.IDLE
        self.landings: list[Landing] = []

    @property
    def tick_seconds(self) -> float:
        """The length of a tick."""
        return self.parameters.tick_seconds

    @property
    def verdict(self) -> tuple[str, str]:
        """How the episode stands or ended, and why."""
        return self.outcome.value, ""

    def joint_rates(self, state: RobotState) -> Array:
        """That are damped where no answer comes, (4,), rad/s."""
        return state.joints[1]

    def close(self) -> None:
        """Give back the plant."""
        self.plant.close()

    def reset(self, seed: int) -> RobotState:
        """A new episode, the left leg standing.

        Course, first state, sensor noise, and any perturbation that exerts a force draw from different generators.
        """
        course_rng, start_rng, sensor_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3))
        self.course = self._file_course or draw_course(self.parameters, course_rng)
        self._terrain = Terrain(self.parameters, self.course)
        self._seed, self._sensor_rng, self._friction_rng = seed, sensor_rng, np.random.default_rng([seed, *b"friction"])
        self._measuring, self._pushing = list[tuple[Perturbation, Memory]](), list[tuple[Perturbation, Memory]]()
        self._perturb()
        self.outcome, self.landings = Outcome.RUNNING, []
        self._tick = self._touchdowns = self._airborne_ticks = 0
        self._applied = no_torque()
        self._fell_into_gap = False
        q, dq = initial_state(self.parameters, self._gait, start_rng)
        self.plant.reset(q, dq, Leg.LEFT)
        self._stand_on(Leg.LEFT, 0.0)
        self.reading = self.plant.observe()
        return self._state()

    def memory_of(self, kind: type[Perturbation]) -> Memory | None:
        """What a perturbation that measures remembers of the episode; None where it is not in force."""
        return next((memory for perturbation, memory in self._measuring if isinstance(perturbation, kind)), None)

    @property
    def stones(self) -> tuple[Span, ...]:
        """Edges of the ground placed since the reset, the first platform and the next stone included; world x, m."""
        return tuple(self._terrain.placed)

    def step(self, torque: Array) -> RobotState:
        """Go on one tick under `torque` (4,), N m: left hip, left knee, right hip, right knee.

        Raises:
            ValueError: not four finite torques.
            RuntimeError: no episode is running.
        """
        torque = np.asarray(torque, dtype=float)
        if torque.shape != (JOINTS,) or not all(map(isfinite, torque.tolist())):
            raise ValueError(f"torque = {torque}: expected four finite numbers, N m")
        if self.outcome is not Outcome.RUNNING:
            raise RuntimeError(f"outcome = {self.outcome}: expected a running episode, call reset first")
        self.push_for_tick()
        self.plant.advance(torque)
        return self.conclude(torque)

    def conclude(self, torque: Array, reading: PlantReading | None = None) -> RobotState:
        """Take in the tick that the plant has walked under `torque`: landings, how the episode stands, measurements.

        `reading`: of a tick in which no foot came down and the robot walked on; None: what the plant says.
        """
        self._applied = torque.copy()
        self._tick += 1
        self.reading = reading or self.plant.observe()
        if reading is None:
            self._count_landings()
            if self.outcome is Outcome.RUNNING:
                self.outcome = self._judge(self.reading)
        return self._state()

    def push(self, force: float, seconds: float) -> None:
        """Push the torso; raises `ValueError` where the plant cannot be pushed."""
        self.plant.push(force, seconds)

    def push_for_tick(self) -> None:
        """Have the perturbations' forces act on the torso in the next tick."""
        for perturbation, memory in self._pushing:
            self.plant.push_for_tick(perturbation.force(memory, self._tick))

    def change(self, parameters: SimulationParameters) -> None:
        """Go on from the present state with another robot, ground and sensors; the course stays until the reset.

        The motors begin at rest, and a swing foot must be seen clear of the ground again before it can come down.
        """
        plant: Plant = load(PLANTS, parameters.plant)(parameters)
        plant.reset(self.reading.q, self.reading.dq, self._stance)
        plant.set_stones(self._terrain.present)
        self.plant.close()
        self.plant, self.parameters = plant, parameters
        self._perturb()

    def _perturb(self) -> None:
        """Who measures and who pushes, with a memory: that of a kind which measured, or of the same push."""
        self._perturbations = self.parameters.in_force()
        measured, pushed = {type(p): memory for p, memory in self._measuring}, dict(self._pushing)
        self._measuring, self._pushing = [], []
        for perturbation in self._perturbations:
            kind = type(perturbation)
            if perturbation.has("measure"):
                memory = measured.get(kind) or self._begun(perturbation, self._sensor_rng)
                memory.parameters = self.parameters
                self._measuring.append((perturbation, memory))
            if perturbation.has("force"):
                rng = np.random.default_rng([self._seed, *kind.__name__.encode()])
                self._pushing.append((perturbation, pushed.get(perturbation) or self._begun(perturbation, rng)))

    def _begun(self, perturbation: Perturbation, rng: np.random.Generator) -> Memory:
        memory = Memory(rng=rng, parameters=self.parameters)
        perturbation.begin(memory)
        return memory

    def _stand_on(self, leg: Leg, x: float) -> None:
        """The stance foot is at world x: place and preview the next stone from there."""
        self._stance, self._stance_x, self._held_at, self._landed = leg, x, x, False
        self._step_began = self._tick
        self._preview = self._terrain.place_next(self._touchdowns + 1, x)
        if depth := self._dropped():
            self._terrain.drop(self._touchdowns, depth)
        self.plant.set_stones(self._terrain.present)
        if spread := self.parameters.friction_spread:
            rubs = self.parameters.ground_friction * (1 - spread * self._friction_rng.random())
            self.plant.set_friction(leg, max(rubs, 1e-6))
        self._ground = Ground(self._terrain.present)

    def _count_landings(self) -> None:
        for touch in self.reading.touches:
            if touch.leg is self._stance or self.outcome is not Outcome.RUNNING:
                continue
            if not self._landed:
                self._land(touch)
            if touch.hold:
                self._touchdowns += 1
                self._stand_on(touch.leg, touch.x)
            if self._touchdowns == self.parameters.stones and self.outcome is Outcome.RUNNING:
                self.outcome = Outcome.WALKED

    def _land(self, touch: Touch) -> None:
        """Note where the swing foot came down, once a step."""
        self._landed = True
        index = self._touchdowns + 1
        stone = self._terrain.placed[index] if self._preview else Span(np.nan, np.nan)
        edges = stone.near - touch.other_x, stone.far - touch.other_x
        landing = Landing(index, self._tick, touch.x - touch.other_x, *edges, touch.hold)
        self.landings.append(landing)
        self._fell_into_gap |= not touch.hold
        if self.parameters.stop_at_miss and (landing.missed or not touch.hold):
            self.outcome = Outcome.MISS if touch.hold else Outcome.GAP_FALL

    def _judge(self, reading: PlantReading) -> Outcome:
        """What else may have ended the episode in this tick."""
        q, dq = reading.q.tolist(), reading.dq.tolist()  # of so few numbers plain Python is ten times as fast
        if not all(map(isfinite, q + dq)):
            return Outcome.DIVERGED
        hip = q[1] - self._support(reading)
        if hip < self.parameters.fall_height or abs(q[2]) > self.parameters.fall_pitch:
            return Outcome.GAP_FALL if self._fell_into_gap else Outcome.FALL
        self._airborne_ticks = 0 if any(reading.contact.tolist()) else self._airborne_ticks + 1
        flies = self._airborne_ticks > 0 and self._airborne_ticks >= flight_ticks(self.parameters, self._dropped())
        if flies and not self._fell_into_gap:
            return Outcome.FLIGHT
        x = float(reading.foot_position[self._stance, 0])
        if self._airborne_ticks:  # a foot that hops does not slip
            self._held_at = x
        if self.parameters.ground_friction <= SLIP_FRICTION and abs(x - self._held_at) > SLIP_DISTANCE:
            return Outcome.SLIP
        if self._tick - self._step_began >= stall_ticks(self.parameters):
            return Outcome.STALL
        return Outcome.RUNNING

    def _dropped(self) -> float:
        """By how much the stone underfoot has given way, m."""
        if self.parameters.terrain == "flat" or not self._touchdowns:
            return 0.0
        stone = self._terrain.placed[self._touchdowns]
        offset = self._stance_x - (stone.near + stone.far) / 2
        return sum(perturbation.drop(self._touchdowns, offset) for perturbation in self._perturbations)

    def _support(self, reading: PlantReading) -> float:
        """The ground's height under the hip, m: on the line over the tops, lower by what the stance foot has sunk."""
        x, z = reading.foot_position[self._stance].tolist()
        gives = self.parameters.ground_stiffness < RUBBER_STIFFNESS and self._ground.is_under(x)
        sunk = max(self._ground.top(x) - z, 0.0) if gives else 0.0
        return self._ground.below(float(reading.q[0])) - sunk

    def _state(self) -> RobotState:
        true = self.reading
        state = RobotState(
            tick=self._tick,
            q=true.q.copy(),
            dq=true.dq.copy(),
            foot_force=true.foot_force.copy(),
            contact=true.contact.copy(),
            touchdowns=self._touchdowns,
            preview=self._preview,
            running=self.outcome is Outcome.RUNNING,
            applied=self._applied,
        )
        for perturbation, memory in self._measuring:
            perturbation.measure(memory, state, true)
        return state if self._estimate is None or self.outcome is Outcome.DIVERGED else self._estimate(state)


def flight_ticks(parameters: SimulationParameters, dropped: float = 0.0) -> int:
    """Without a foot on the ground, so many are a flight: 50 ms, or half a period of the robot on its ground.

    Ground of stiffness k that has carried nearly three times the weight of the mass m throws it back for half a period
    pi sqrt(m / k); it comes down again. On a stone that has `dropped`, m, longer by the fall onto it.
    """
    half_period = pi * sqrt(true_mass(parameters) / parameters.ground_stiffness)
    fall = sqrt(2 * dropped / GRAVITY)
    tick = parameters.tick_seconds
    return max(round(FLIGHT_SECONDS / tick), ceil(half_period / tick)) + ceil(fall / tick)


def stall_ticks(parameters: SimulationParameters) -> int:
    """Without a touchdown, so many are a stall."""
    return round(STALL_SECONDS / parameters.tick_seconds)
