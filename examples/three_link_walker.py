"""A walker of your own, twice as heavy as believed, learns to walk: torso, two straight legs, point feet, two motors.

The packages supply what such a robot needs from its URDF: a plant with impacts (rabbit_sim), a gait on its hybrid zero
dynamics (rabbit_gait_design), nominal model and outputs (rl_cbf_clf_controller), CLF-QP (cbf_clf_qp), learner
(rl_trainer). Straight swing legs pass through the ground in mid-swing: a touchdown counts only ahead of the stance
foot, after the foot has been 5 mm above the ground there (Grizzle, Abba, Plestan 2001). A tick lasts 10 ms.

    true V-dot = nominal V-dot(mu) + alpha mu + beta, learned from 12 episodes of at most 10 steps
    python examples/three_link_walker.py         # 15 minutes; of 100 steps nominal 1.7 (1.3 to 2.2), learned all
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.measurement import model_error
from cbf_clf_qp.problem import Problem
from cbf_clf_qp.tick import Tick
from rabbit_description.planar_urdf import scaled, with_planar_base
from rabbit_description.state import TICK_SECONDS, Leg
from rabbit_experiments.summary import mean_interval
from rabbit_gait_design.hybrid_zero_dynamics import RepeatedStep, Walker, impact_invariant
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rabbit_sim.pinned_dynamics import PinnedDynamics, UrdfFeet, standing
from rabbit_sim.planar_plant import PlanarPlant, ahead
from rabbit_sim.plant import PlantReading
from rl_cbf_clf_controller.planar_robot import PinnedRobot
from rl_cbf_clf_controller.policy import LearnedPolicy, ZeroPolicy
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.virtual_constraints import Angles, OutputExpressions, VirtualConstraints
from rl_trainer.parameters import TrainingParameters
from rl_trainer.session import policy_of
from rl_trainer.system_transitions import SystemTick, SystemTicks
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

URDF = with_planar_base((Path(__file__).parent / "three_link_walker.urdf").read_text())
HEAVY, BELIEVED = scaled(URDF, 2.0), read_robot(URDF)
SWAP = np.array([0, 1, 2, 4, 3])  # base x, z, pitch, left hip, right hip; the left leg's place is the stance leg's
ANGLES = Angles(  # outputs: the torso's pitch and the sum of the legs' angles; phase: the stance leg's angle
    controlled=np.array([[0.0, 0, 1, 0, 0], [0.0, 0, 2, 1, 1]]), phase_angle=np.array([0.0, 0, 1, 1, 0])
)
WALKER = Walker(PinocchioModel(URDF), ANGLES, SWAP)
LATER = np.array([[0.1770, 0.3805, 0.3994, 0.3029], [0.3227, -0.1810, -0.1572, 0.0]])  # three_link_gait.py finds them
PATH = impact_invariant(WALKER, LATER, phase_angle_end=0.2527)
START = RepeatedStep(WALKER, PATH).start
EPS, GAINS, SLACK_WEIGHT, TORQUE_LIMIT = 0.2, (1.0, 1.8), 10.0, 100.0  # the same for all, limit in N m
FALLEN_PITCH, FALLEN_HIP, LONGEST_STEP, EVALUATION = 1.2, 0.5, 300, 2**32  # rad, m, ticks, a seed of no training
OBSERVATION = ("y1", "y2", "dy1", "dy2", "phase", "dphase")
UNITS = tuple(zip(OBSERVATION, (0.0, 0.0, 0.0, 0.0, 0.5, 2.0), (0.1, 0.1, 0.5, 0.5, 0.4, 0.7), strict=True))  # walked
SCALES = (1.5,), (60.0,), (4.0,)  # of alpha, beta and their error in V-dot, over |LgV| + 1
UPDATES = {"updates_per_tick": 2.0, "updates_least": 400, "batch": 160}  # slower ones than by default, and more
LEARNER = {"sigma": 2.0, "probe_noise": 6.0, "actor_rate": 6e-4, "critic_rate": 1e-3, "polyak": 5e-4} | UPDATES
PROBLEM = Problem("three-link", 2, ("V",), OBSERVATION, UNITS, *SCALES)
robot = PinnedRobot(BELIEVED.structure)
outputs = OutputExpressions(robot.q, robot.dq, ANGLES)
SYSTEM = robot.system(outputs.parameters, outputs.rates)
CLF = Clf(outputs.y, EPS, GAINS, SLACK_WEIGHT)


class Controller:
    """The believed robot's CLF-QP with a policy's alpha and beta, or the exact ones of the URDF `true`, in its row."""

    def __init__(self, policy: LearnedPolicy, true: str | None = None) -> None:
        tick = Tick(SYSTEM, [CLF], limit=TORQUE_LIMIT, solver="osqp")
        self.ticks, self._error, self._policy = SystemTicks(tick, PROBLEM), model_error(tick.terms), policy
        self._path, self._true = VirtualConstraints(PATH, ANGLES), read_robot(true).row if true else None

    def tick(self, reading: PlantReading, noise: np.ndarray) -> SystemTick:
        """Terms, decision and torques, stance hip first; `noise` (2,) is added to mu."""
        is_left = reading.contact.argmax() == Leg.LEFT
        q, dq = (reading.q, reading.dq) if is_left else (reading.q[SWAP], reading.dq[SWAP])
        x, path, now = np.concatenate([q, dq]), self._path.parameters(q).values(), self._path.evaluate(q, dq)
        p, observation = np.concatenate([BELIEVED.row, *path]), np.array([*now.eta, now.phase, now.phase_rate])
        estimates = self._policy.act(observation, self.ticks.LgV(x, p))
        if self._true is not None:
            error = self._error(x, p, np.concatenate([self._true, *path]))
            estimates = Estimates(error.alpha, error.beta, error.output_error)
        tick = self.ticks.decide(x, p, estimates, observation, noise)
        torque = tick.control.clip(-TORQUE_LIMIT, TORQUE_LIMIT)
        return replace(tick, mu=np.linalg.solve(tick.seen.control_a, torque - tick.seen.control_b))


def walk(controller: Controller, urdf: str, seed: int, steps: int, sigma: float = 0.0) -> tuple[int, list[Transition]]:
    """Steps that the true robot takes, at most `steps`, and what was measured; `sigma` explores, rad/s^2."""
    rng, feet = np.random.default_rng(seed), UrdfFeet(urdf)
    plant = PlanarPlant(PinnedDynamics(urdf, feet), ahead, torque_limit=TORQUE_LIMIT)
    q = START[0] + np.pad(0.02 * rng.standard_normal(3), (2, 0))
    dq = START[1] * (1 + np.pad(0.05 * rng.standard_normal(3), (2, 0)))
    plant.reset(*standing(feet, q, dq, Leg.LEFT), Leg.LEFT)
    taken, since, before, measured = 0, 0, None, list[Transition]()
    while taken < steps and since < LONGEST_STEP:
        reading = plant.observe()
        if abs(reading.q[2]) > FALLEN_PITCH or reading.q[1] < FALLEN_HIP or reading.foot_force[:, 1].min() < 0:
            break  # fallen, or the ground would have to pull
        now = controller.tick(reading, sigma * rng.standard_normal(2))
        if before:
            measured.append(controller.ticks.transition(len(measured), before, now, TICK_SECONDS))
        plant.advance(now.control if reading.contact[Leg.LEFT] else now.control[::-1])
        landed = len(plant.observe().touches)
        taken, since, before = taken + landed, 0 if landed else since + 1, None if landed else now
    return taken, measured


def train(seed: int, episodes: int) -> LearnedPolicy:
    """A policy learned on the heavy robot, from nothing and by the reward alone."""
    p = TrainingParameters(problem=PROBLEM, seed=seed, hidden1=64, hidden2=64, **LEARNER)
    trainer = Trainer(p)
    for episode in range(episodes):
        plan = trainer.begin_episode()
        steps, measured = walk(Controller(policy_of(plan, p)), HEAVY, plan.seed, p.walking_steps, plan.sigma)
        for item in measured:
            trainer.take(item)
        trainer.learn(max(p.updates_least, round(p.updates_per_tick * len(measured))))
        trainer.episode += 1
        error = np.sqrt(np.mean([np.square(item.error / (1 + np.linalg.norm(item.LgV))) for item in measured]))
        print(f"seed {seed}, episode {episode + 1}: {steps} steps, V-dot error / (1 + |LgV|): {error:.2f}", flush=True)
    return policy_of(trainer.begin_episode(), p)


def main() -> None:
    parser = argparse.ArgumentParser(description="nominal, learned and oracle CLF-QP on a robot of twice its mass")
    parser.add_argument("--train", type=int, default=12, metavar="N", help="episodes of each training (default 12)")
    parser.add_argument("--seeds", type=int, default=5, metavar="N", help="trainings, walked from their own starts")
    parser.add_argument("--steps", type=int, default=100, metavar="N", help="steps to walk (default 100)")
    parser.add_argument("--walks", type=int, default=3, metavar="N", help="walks of each controller and seed")
    options, taken = parser.parse_args(), dict[str, list[float]]()
    for seed in range(1, options.seeds + 1):
        nominal = Controller(ZeroPolicy(PROBLEM))
        cases = {
            "nominal, true mass as believed": (nominal, URDF),
            "nominal, twice the mass": (nominal, HEAVY),
            "oracle, twice the mass": (Controller(ZeroPolicy(PROBLEM), HEAVY), HEAVY),
            "learned, twice the mass": (Controller(train(seed, options.train)), HEAVY),
        }
        for name, (controller, urdf) in cases.items():
            starts = EVALUATION + 100 * seed + np.arange(options.walks)
            steps = [walk(controller, urdf, int(start), options.steps)[0] for start in starts]
            taken.setdefault(name, []).append(float(np.mean(steps)))
            print(f"seed {seed}: {name}: {steps} steps", flush=True)
    for name, means in taken.items():
        low, high = mean_interval(np.array(means)) or (np.nan, np.nan)
        print(f"{name}: {np.mean(means):.1f} steps of {options.steps} (95% {low:.1f} to {high:.1f})")


if __name__ == "__main__":
    main()
