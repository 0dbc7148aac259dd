"""A walker of your own, twice as heavy as its model, learns to walk: torso, two straight legs, point feet, two motors.

Plant with impacts, gait on its hybrid zero dynamics, nominal model, CLF-QP and learner all come from its URDF. Straight
swing legs pass through the ground in mid-swing: a touchdown counts only ahead of the stance foot, after the foot has
been 5 mm above the ground there (Grizzle, Abba, Plestan 2001). It takes 15 minutes; `--episodes 0` learns nothing.
"""

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import typer
from cbf_clf_qp import Clf, Tick
from cbf_clf_qp.functions import places_of
from rabbit_description.planar_urdf import scaled, with_planar_base
from rabbit_description.state import TICK_SECONDS, Leg
from rabbit_experiments.summary import mean_interval
from rabbit_gait_design.hybrid_zero_dynamics import RepeatedStep, Walker, impact_invariant
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rabbit_sim.pinned_dynamics import PinnedDynamics, UrdfFeet, standing
from rabbit_sim.planar_plant import PlanarPlant, ahead
from rl_cbf_clf_controller.planar_robot import PinnedRobot
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.virtual_constraints import Angles, OutputExpressions, VirtualConstraints
from rl_trainer.systems import LearnedPolicy, Problem, SystemTicks, TrainingParameters, learn

URDF = with_planar_base((Path(__file__).parent / "three_link_walker.urdf").read_text())
HEAVY, NOMINAL = scaled(URDF, 2.0), read_robot(URDF)
SWAP = np.array([0, 1, 2, 4, 3])  # base x, z, pitch, left hip, right hip; the left leg's place is the stance leg's
ANGLES = Angles(np.array([[0.0, 0, 1, 0, 0], [0.0, 0, 2, 1, 1]]), np.array([0.0, 0, 1, 1, 0]))  # y: pitch, legs; phase
WALKER = Walker(PinocchioModel(URDF), ANGLES, SWAP)
LATER = np.array([[0.1770, 0.3805, 0.3994, 0.3029], [0.3227, -0.1810, -0.1572, 0.0]])  # three_link_gait.py finds them
PATH = impact_invariant(WALKER, LATER, phase_angle_end=0.2527)
START, DESIRED = RepeatedStep(WALKER, PATH).start, VirtualConstraints(PATH, ANGLES)
LIMIT, PITCH, HIP, LONGEST_STEP, EVALUATION = 100.0, 1.2, 0.5, 300, 2**32  # N m; rad, m: fallen; ticks; a seed

robot = PinnedRobot(NOMINAL.structure)
outputs = OutputExpressions(robot.q, robot.dq, ANGLES)
SYSTEM = robot.system(outputs.parameters, outputs.rates)
SEEN = ca.vertcat(outputs.y, SYSTEM.derivative(outputs.y), outputs.phase, outputs.phase_rate)
UNITS = (("y1", 0, 0.1), ("y2", 0, 0.1), ("dy1", 0, 0.5), ("dy2", 0, 0.5), ("phase", 0.5, 0.4), ("dphase", 2, 0.7))
SCALES = (1.5,), (60.0,), (4.0,)  # of alpha, beta and their error in V-dot, over |LgV| + 1
PROBLEM = Problem("three-link", 2, ("V",), tuple(name for name, *_ in UNITS), UNITS, *SCALES)
TICK = Tick(SYSTEM, [Clf(outputs.y, 0.2, gains=(1.0, 1.8))], limit=LIMIT, reads={"observation": SEEN}, solver="osqp")
TICKS = SystemTicks(TICK, PROBLEM, TICK_SECONDS, LIMIT)
SLOWER = {"updates_per_tick": 2.0, "updates_least": 400, "batch": 160, "hidden1": 64, "hidden2": 64}  # and more updates
LEARNER = {"sigma": 2.0, "probe_noise": 6.0, "actor_rate": 6e-4, "critic_rate": 1e-3, "polyak": 5e-4, **SLOWER}


def walk(urdf: str, seed: int, steps: int, policy: Any = None, oracle: bool = False, sigma: float = 0.0) -> int:
    """Steps that the true robot takes, at most `steps`; `sigma` explores, rad/s^2. `TICKS` has what was measured."""
    rng, feet, taken, since = np.random.default_rng(seed), UrdfFeet(urdf), 0, 0
    plant = PlanarPlant(PinnedDynamics(urdf, feet), ahead, torque_limit=LIMIT)
    q = START[0] + np.pad(0.02 * rng.standard_normal(3), (2, 0))
    dq = START[1] * (1 + np.pad(0.05 * rng.standard_normal(3), (2, 0)))
    plant.reset(*standing(feet, q, dq, Leg.LEFT), Leg.LEFT)
    row = read_robot(urdf).row
    true = {name: row[place] for name, (place, _) in places_of(robot.parameters).items()}
    TICKS.begin(policy, true if oracle else None)
    while taken < steps and since < LONGEST_STEP:
        now = plant.observe()
        if abs(now.q[2]) > PITCH or now.q[1] < HIP or now.foot_force[:, 1].min() < 0:
            break  # fallen, or the ground would have to pull
        order, motors = (slice(None), 1) if now.contact[Leg.LEFT] else (SWAP, -1)
        p = np.concatenate([NOMINAL.row, *DESIRED.desired(DESIRED.phase(now.q[order])), DESIRED.scale])
        x = np.concatenate([now.q[order], now.dq[order]])
        plant.advance(TICKS(x, p, sigma * rng.standard_normal(2)).control[::motors])
        landed = len(plant.observe().touches)
        taken, since = taken + landed, 0 if landed else since + 1
        if landed:
            TICKS.interrupt()
    return taken


def train(seed: int, episodes: int) -> LearnedPolicy:
    """A policy learned on the heavy robot, from nothing and by the reward alone."""
    parameters = TrainingParameters(problem=PROBLEM, seed=seed, episodes=episodes, **LEARNER)
    return learn(parameters, TICKS, lambda policy, plan: walk(HEAVY, plan.seed, 10, policy, sigma=plan.sigma))


def main(episodes: int = 12, seeds: int = 5, steps: int = 100, walks: int = 3) -> None:
    """Nominal, learned and oracle CLF-QP on a robot of twice its mass: trainings of so many episodes, steps a walk."""
    taken = dict[str, list[float]]()
    for seed in range(1, seeds + 1):
        cases: dict[str, Any] = {"nominal, true mass as in the model": (URDF, None)}
        cases |= {"nominal, twice the mass": (HEAVY, None), "oracle, twice the mass": (HEAVY, None, True)}
        cases |= {"learned, twice the mass": (HEAVY, train(seed, episodes))} if episodes else {}
        for name, (urdf, *estimates) in cases.items():
            walked = [walk(urdf, EVALUATION + 100 * seed + k, steps, *estimates) for k in range(walks)]
            taken.setdefault(name, []).append(float(np.mean(walked)))
            print(f"seed {seed}: {name}: {walked} steps", flush=True)
    for name, means in taken.items():
        print(f"{name}: {np.mean(means):.1f} steps of {steps} {np.round(mean_interval(np.array(means)) or np.nan, 1)}")


if __name__ == "__main__":
    typer.run(main)
