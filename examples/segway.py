"""A wheeled pendulum learns to keep a speed limit, the task of Taylor et al. 2020: heavier and weaker than believed.

    state x = (v, theta, omega): the wheels' speed, the lean (forward positive), its rate;  input: the motor's torque
    CLF:      y = theta - the lean that the rider asks for, relative degree 2; a soft row
    barrier:  B = LIMIT - look-ahead speed >= 0, relative degree 1; a row with a slack of last resort

To brake, the wheels must first run forward, so that the body leans back; a limit on v alone would make the body fall.
The barrier therefore limits the speed of the body at HEIGHT plus what the lean will add to it.
"""

import argparse

import casadi as ca
import numpy as np
from cbf_clf_qp import Barrier, Clf, Estimates, NumpyFunction, System, Tick, model_error
from cbf_clf_qp.functions import Array
from matplotlib.figure import Figure
from rabbit_experiments.summary import mean_interval, wilson
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_trainer.parameters import TrainingParameters
from rl_trainer.system_transitions import SystemTicks
from rl_trainer.training import Trainer

LIMIT, KEPT, HEIGHT, AHEAD, RATE = 3.0, 0.01, 1.2, 4.0, 4.0  # m/s; m/s over it; m; m/s a radian of lean; 1/s
DT, TICKS, SUBSTEPS, GRAVITY, RADIUS, WHEELS = 0.01, 800, 10, 9.81, 0.2, 12.0  # s; a ride; -; m/s^2; m, kg
NOISE, EPISODES, UPDATES, RIDES = 2.0, 4, 600, 10  # rad/s^2; of a training; of an episode; that test a policy
BELIEVED, TRUE = (60, 0.8, 5.0, 1.0, 0.5), (70, 0.85, 6.5, 0.8, 1.0)  # body, kg; center, m; kg m^2; motor; drag, Nm s

body, center, inertia, motor, drag, lean = p = [ca.SX.sym(s) for s in ("body", "center", "I", "motor", "drag", "lean")]
v, theta, omega, torque = (ca.SX.sym(name) for name in ("v", "theta", "omega", "torque"))
lever, coupling = ca.vertcat(1 / RADIUS, -1), body * center * ca.cos(theta)  # drag acts between body and wheels
mass = ca.blockcat([[body + WHEELS, coupling], [coupling, inertia + body * center**2]])
forces = body * center * ca.sin(theta) * ca.vertcat(omega**2, GRAVITY) - lever * drag * (v / RADIUS - omega)
v_dot, omega_dot = ca.vertsplit(ca.inv_minor(mass) @ (forces + lever * motor * torque))
look_ahead = v + HEIGHT * ca.cos(theta) * omega + AHEAD * ca.sin(theta)

SEGWAY = System(ca.vertcat(v, theta, omega), torque, ca.vertcat(v_dot, omega, omega_dot), p)
dv, domega = v_dot * DT / SUBSTEPS, omega_dot * DT / SUBSTEPS
later = SEGWAY.x + ca.vertcat(dv, (omega + domega / 2) * DT / SUBSTEPS, domega)
PLANT = NumpyFunction.of("plant", {"x": SEGWAY.x, "p": SEGWAY.p, "u": torque}, {"x": later})
BARRIER = Barrier("B", LIMIT - look_ahead, poles=(RATE,))
TICK = Tick(SEGWAY, [Clf(theta - lean, eps=0.3), BARRIER], reads={"look_ahead": look_ahead})
UNITS = (("v", 1.5, 1.5), ("theta", 0.0, 0.2), ("omega", 0.0, 0.6))
SCALES = (1.0, 1.0), (8.0, 8.0), (1.0, 1.0)  # of alpha, beta and their error
PROBLEM = Problem("segway", 1, TICK.names, ("v", "theta", "omega"), UNITS, *SCALES, mu_unit=3.0)
RIDDEN, ERROR = SystemTicks(TICK, PROBLEM), model_error(TICK.terms)
Policy = ActorPolicy | str  # a learned one, or "nominal", or "oracle"


def estimates(policy: Policy, x: Array, p: Array) -> Estimates:
    """What a policy says of the error."""
    if isinstance(policy, ActorPolicy):
        return policy.act(x, RIDDEN.LgV(x, p))
    error = ERROR(x, p, np.array([*TRUE, p[-1]]))
    return Estimates(error.alpha, error.beta) if policy == "oracle" else TICK.no_error()


def ride(seed: tuple[int, ...], policy: Policy, noise: float = 0.0, trainer: Trainer | None = None) -> Array:
    """Look-ahead and wheels' speed (TICKS, 2) of a true ride, m/s; inf where it fell. The `trainer` takes its ticks."""
    rng, last, speeds = np.random.default_rng(seed), None, np.full((TICKS, 2), np.inf)
    x, lean, turn = rng.uniform((0, -0.05, 0), (1.5, 0.05, 0)), rng.uniform(0.1, 0.2), rng.integers(300, 450)
    for k in range(TICKS):  # the rider leans forward, back for a second, and forward again
        p = np.array([*BELIEVED, -lean if turn < k < turn + 100 else lean])
        now = RIDDEN.decide(x, p, estimates(policy, x, p), x, noise * rng.standard_normal(1))
        if trainer and last:
            trainer.take(RIDDEN.transition(k - 1, last, now, DT))
        last, speeds[k] = now, (now.seen.look_ahead[0], x[0])
        for _ in range(SUBSTEPS):
            x = PLANT(x, np.array([*TRUE, 0.0]), now.control).x
        if abs(x[1]) > 1:
            break
    return speeds


def train(seed: int, learner: str = "regression", episodes: int = EPISODES) -> Policy:
    """Ride with the present estimates and noise, learn from what was measured, repeat."""
    slow = {"actor_rate": 6e-4, "critic_rate": 1e-3, "polyak": 5e-4, "batch": 160}
    trainer = Trainer(TrainingParameters(problem=PROBLEM, seed=seed, learner=learner, hidden1=64, hidden2=64, **slow))
    policy: Policy = "nominal"
    for episode in range(episodes):
        ride((seed, 0, episode), policy, NOISE, trainer)
        trainer.learn(UPDATES)
        policy = ActorPolicy(trainer.policy_file())
    return policy


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5], help="of the trainings")
    parser.add_argument("--learner", default="regression", help="or ddpg")
    parser.add_argument("--picture", help="file for a picture of the first test ride")
    asked = parser.parse_args()
    axes = (figure := Figure(figsize=(7, 3.2), layout="constrained")).subplots()
    print("over the limit, m/s: mean of the trainings' worst rides [95%], worst, wheels; rides that kept it [95%]")
    rows: dict[str, list[Policy]] = {"nominal": ["nominal"], "learned": [], "oracle": ["oracle"]}
    rows["learned"] += [train(seed, asked.learner) for seed in asked.seeds]
    for name, each in rows.items():
        tests = [[ride((s, 1, k), each[i % len(each)]) for k in range(RIDES)] for i, s in enumerate(asked.seeds)]
        over, wheels = np.moveaxis(np.max(tests, axis=2) - LIMIT, 2, 0)
        worst, kept = over.max(1), int((over <= KEPT).sum())
        mean, share = np.round(mean_interval(worst) or np.nan, 4), np.round(wilson(kept, over.size), 2)
        print(f"{name} {worst.mean():.4f} {mean} {worst.max():.4f} {wheels.max():.3f}; {kept} of {over.size} {share}")
        axes.plot(DT * np.arange(TICKS), tests[0][0][:, 0], label=name, linewidth=5 - 1.7 * len(axes.lines))
    axes.axhline(LIMIT, color="black", linestyle="--", label="limit")
    axes.set(xlabel="time (s)", ylabel="look-ahead speed (m/s)")
    axes.legend()
    if asked.picture:
        figure.savefig(asked.picture, dpi=120)
