"""N robots in MuJoCo at once: `mujoco.rollout` walks a tick of all of them, numpy judges it.

A `Simulation` for each robot knows course, landings and how the episode stands. In most ticks nothing of that can
change: no foot that could come down is near the ground or carries anything, and the robot stands on a foot, high and
upright. Such a tick is noted for all robots at once; any other goes through the robot's `Simulation`, which also asks
the sensors that draw noise. So the rules are written there and nowhere else. A robot whose joint torques depend on the
state within the tick (gears, damping, springs), or that carries a pendulum, takes its substeps one by one.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from rabbit_description.planar_urdf import BASE
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import DOF, LEG_JOINTS, Array, RobotState

from rabbit_sim.actuation import Actuation
from rabbit_sim.kinematics import foot
from rabbit_sim.mujoco_plant import MujocoPlant
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import CLEAR_HEIGHT, CONTACT_FORCE, PlantReading
from rabbit_sim.robot_urdf import leg_shape
from rabbit_sim.simulation import SLIP_DISTANCE, SLIP_FRICTION, Simulation, stall_ticks

JOINT_TORQUES, PUSHES = mujoco.mjtState.mjSTATE_QFRC_APPLIED, mujoco.mjtState.mjSTATE_XFRC_APPLIED
PRESSING, IN_THE_PLANE = [2, 5], [0, 2, 3, 5]  # of the forces (x, y, z) of left and right foot on the stones
ROUNDING = 1e-9  # m, by which numpy may place a foot elsewhere: what is so near goes to `Simulation`


class BatchSimulation:
    """The robots of `simulations`, which nobody else steps from now on.

    `states`: what the controllers get; `true_force` (N, 2, 2): the feet's, without noise, N. Raises ValueError for a
    plant that is not MuJoCo's, or for ticks of different lengths.
    """

    def __init__(self, simulations: Sequence[Simulation]) -> None:
        self.simulations = list(simulations)
        for simulation in simulations:
            plant_of(simulation)
        self._rollout = Rollout(nthread=0)

    @property
    def running(self) -> Array:
        """Which robots' episodes go on, (N,)."""
        return self.states.running

    def reset(self, seeds: Sequence[int]) -> RobotStates:
        """Begin an episode with each robot; see `Simulation.reset`."""
        pairs = zip(self.simulations, seeds, strict=True)
        self.states = RobotStates.of([simulation.reset(seed) for simulation, seed in pairs])
        n = len(self.states)
        self._engine = np.zeros((n, 1 + 2 * DOF))  # time, which stands still, q, dq
        self._feet_x, self._feet_z = np.zeros((2, n, 2))
        self._is_clear = np.zeros((n, 2), dtype=bool)
        self._is_airborne, self._is_crossing = np.zeros((2, n), dtype=bool)
        self._stance = np.zeros(n, dtype=int)
        self._held_at, self._step_began = np.zeros((2, n))
        self._lowest, self._highest = np.zeros((2, n))
        self.true_force = np.zeros((n, 2, 2))
        self._actuation = Actuation(*(simulation.parameters for simulation in self.simulations))
        self._arrange()
        for i in range(n):
            self._begin(i)
        return self.states

    def restart(self, i: int, simulation: Simulation, seed: int) -> None:
        """Begin an episode with another robot in place of robot `i`, or with the same one."""
        plant, before = plant_of(simulation), self.simulations[i]
        self.simulations[i] = simulation
        self.states[i] = simulation.reset(seed)
        if simulation is not before:
            self._actuation = self._actuation.going_on(np.arange(len(self.states)), self._parameters)
            self._arrange()
        self._actuation.rest(i)
        plant.watch.clear = self._is_clear[i]
        self._begin(i)

    def keep(self, rows: Array) -> None:
        """Go on with some of the robots, by number."""
        self.simulations = [self.simulations[i] for i in rows]
        self.states = self.states.kept(rows)
        for name in ROWS:
            setattr(self, name, getattr(self, name)[rows])
        self._actuation = self._actuation.going_on(rows, self._parameters)
        self._arrange()

    def step(self, torques: Array) -> RobotStates:
        """Go on one tick under `torques` (N, 4), N m; see `Simulation.step`. All robots are running."""
        states, before = self.states, self._engine.copy()
        states.tick = states.tick + 1
        states.applied = torques.copy()
        self._walk(torques)
        path, sensed = self._path, self._sensed
        self._engine[:, 1:] = path[:, -1]
        states.q, states.dq = path[:, -1, :DOF].copy(), path[:, -1, DOF:].copy()
        states.contact = sensed.min(axis=1)[:, PRESSING] < -CONTACT_FORCE
        forces = sensed.sum(axis=1)[:, IN_THE_PLANE].reshape(-1, 2, 2)
        self.true_force = forces / -self._substeps + 0.0  # no -0.0, as alone
        states.foot_force = self.true_force.copy()
        special = self._may_land() | self._is_doubtful()
        for i in (special | self._measures).nonzero()[0].tolist():
            simulation = self._simulation_of(i)
            if special[i]:
                states_of_tick = np.concatenate([before[i : i + 1, 1:], path[i]])
                plant_of(simulation).follow(states_of_tick, -sensed[i][:, IN_THE_PLANE].reshape(-1, 2, 2))
                self._note(i, simulation.conclude(torques[i]))
            else:
                states[i] = simulation.conclude(torques[i], self._reading(i))
        return states

    def _walk(self, torques: Array) -> None:
        """Walks this tick: `_path` has q and dq after each substep, `_sensed` what the feet's sensors say."""
        driven, pushes = self._actuation.advance(torques), np.zeros((len(torques), self._substeps))
        for i in self._pushed:
            simulation = self._simulation_of(i)
            simulation.push_for_tick()
            pushes[i] = plant_of(simulation).next_pushes()
        for i in self._one_by_one:
            plant = plant_of(self.simulations[i])
            plant.walk(driven[i], pushes[i].tolist(), self._path[i], self._sensed[i])
        if self._models:
            at_once = self._at_once
            self._control[:, :, BASE:DOF] = driven[at_once]
            if self._pushed:
                self._control[:, :, self._push_at] = pushes[at_once]
            self._rollout.rollout(
                self._models,
                self._data,
                self._engine[at_once],
                self._control,
                control_spec=self._applied,
                nstep=self._substeps,
                state=self._after,
                sensordata=self._felt,
                skip_checks=True,
            )
            self._path[at_once], self._sensed[at_once] = self._after[:, :, 1:], self._felt

    def _may_land(self) -> Array:
        """Whether a foot may come down, or whether it is off the ground is not sure, (N,)."""
        q = self._path.transpose(0, 2, 1)  # substeps last
        unsure = self._feet_z - self._lowest[:, None] > CLEAR_HEIGHT
        self._is_clear |= self._feet_z - self._highest[:, None] > CLEAR_HEIGHT
        upper, knee = q[:, 2:3] + q[:, BASE:DOF:LEG_JOINTS], q[:, BASE + 1 : DOF : LEG_JOINTS]
        x, z = foot(q[:, 0:1], q[:, 1:2], upper, knee, self._shapes, np)
        self._feet_x, self._feet_z = x[..., -1], z[..., -1]
        is_low = z.min(axis=2) - self._highest[:, None] < ROUNDING
        comes_down = self._is_clear & (is_low | self.states.contact) | unsure & ~self._is_clear
        return comes_down.any(axis=1) | self._is_crossing

    def _is_doubtful(self) -> Array:
        """Whether the episode may end, (N,), or a flight begins, goes on or ends: what `Simulation` judges."""
        states, p = self.states, self._limits
        was_airborne: Array = self._is_airborne
        self._is_airborne = ~(states.contact[:, 0] | states.contact[:, 1])
        travel = np.abs(self._feet_x[self._rows, self._stance] - self._held_at)
        is_sound: Array = (states.q[:, 1] - self._highest >= p[0]) & (np.abs(states.q[:, 2]) <= p[1]) & (travel <= p[2])
        is_sound &= np.isfinite(states.dq.sum(axis=1)) & (states.tick - self._step_began < self._stall_ticks)
        return ~is_sound | was_airborne | self._is_airborne

    def _simulation_of(self, i: int) -> Simulation:
        """Returns the simulation of robot `i`, which now knows how many ticks have been walked."""
        simulation = self.simulations[i]
        simulation._tick = int(self.states.tick[i]) - 1
        return simulation

    def _reading(self, i: int) -> PlantReading:
        """The truth about robot `i` after a tick in which no foot came down."""
        plant, q, dq = plant_of(self.simulations[i]), self.states.q[i].copy(), self.states.dq[i].copy()
        path = self._path[i].copy() if plant.keeps_path else None
        contact = self.states.contact[i].copy()
        return PlantReading(q, dq, self.true_force[i], plant.kinematics.positions(q), contact, (), path)

    def _note(self, i: int, state: RobotState) -> None:
        """What the simulation of robot `i` says."""
        simulation = self.simulations[i]
        self.states[i] = state
        self.true_force[i] = simulation.reading.foot_force
        self._stance[i], self._held_at[i] = simulation._stance, simulation._held_at
        self._step_began[i] = simulation._step_began
        self._is_crossing[i] = any(plant_of(simulation).watch.crossings)
        tops = [span.top for span in simulation._terrain.present]
        self._lowest[i], self._highest[i] = min(0.0, *tops), max(0.0, *tops)

    def _begin(self, i: int) -> None:
        """Robot `i` has been reset."""
        simulation = self.simulations[i]
        self._engine[i, 1:] = np.concatenate([simulation.reading.q, simulation.reading.dq])
        self._feet_x[i], self._feet_z[i] = simulation.reading.foot_position.T
        self._is_clear[i] = False
        self._is_airborne[i] = not simulation.reading.contact.any()
        self._note(i, self.states[i])

    @property
    def _parameters(self) -> list[SimulationParameters]:
        return [simulation.parameters for simulation in self.simulations]

    def _arrange(self) -> None:
        """What follows from which robots there are."""
        plants, parameters = [plant_of(simulation) for simulation in self.simulations], self._parameters
        if len({p.tick_seconds for p in parameters}) > 1:
            raise ValueError("tick_seconds: expected the same of all robots of a batch")
        self._substeps, self._stall_ticks = parameters[0].substeps, stall_ticks(parameters[0])
        self._rows = np.arange(len(plants))
        is_stepped = np.array([plant.feeds_back or plant.model.nq != DOF for plant in plants])
        self._one_by_one, numbers = is_stepped.nonzero()[0].tolist(), (~is_stepped).nonzero()[0]
        self._at_once = numbers if is_stepped.any() else slice(None)
        self._measures = np.array([bool(s._measuring or s._estimate) for s in self.simulations])
        slips = [SLIP_DISTANCE - ROUNDING if p.ground_friction <= SLIP_FRICTION else np.inf for p in parameters]
        heights, pitches = ([getattr(p, name) for p in parameters] for name in ("fall_height", "fall_pitch"))
        self._limits = np.array([heights, pitches, slips])
        shapes = np.array([leg_shape(p) for p in parameters])
        self._shapes = shapes.T[:, :, None, None]
        self._pushed = [i for i, simulation in enumerate(self.simulations) if simulation._pushing]
        self._path = np.empty((len(plants), self._substeps, 2 * DOF))
        self._sensed = np.empty((len(plants), self._substeps, plants[0].model.nsensordata))
        for i, plant in enumerate(plants):
            plant.watch.clear = self._is_clear[i]
        self._models = [plants[i].model for i in numbers]
        if self._models:
            model = self._models[0]
            self._applied = int(JOINT_TORQUES | PUSHES if self._pushed else JOINT_TORQUES)
            self._push_at = model.nv + 6 * model.body("torso").id
            self._data = [mujoco.MjData(model)]
            shape = len(self._models), self._substeps
            self._control = np.zeros((*shape, mujoco.mj_stateSize(model, self._applied)))
            self._after = np.empty((*shape, 1 + 2 * DOF))
            self._felt = np.empty((*shape, model.nsensordata))


ROWS = (
    *("_engine", "_feet_x", "_feet_z", "_is_clear", "_is_airborne", "_is_crossing", "_stance", "_held_at"),
    *("_step_began", "_lowest", "_highest", "true_force"),
)


def plant_of(simulation: Simulation) -> MujocoPlant:
    """Raises ValueError where it is not MuJoCo's."""
    plant = simulation.plant
    if not isinstance(plant, MujocoPlant):
        raise ValueError(f"plant = {simulation.parameters.plant}: expected mujoco, in which a batch walks")
    return plant
