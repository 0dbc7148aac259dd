"""A wheeled pendulum learns to keep a speed limit, the task of Taylor et al. 2020: heavier and weaker than its model.

    state x = (v, theta, omega): the wheels' speed, the lean (forward positive), its rate;  input: the motor's torque
    CLF:      y = theta - the lean that the rider asks for, relative degree 2; a soft row
    barrier:  B = LIMIT - look-ahead speed >= 0, relative degree 1; a row with a slack of last resort

To brake, the wheels must first run forward, so that the body leans back; a limit on v alone would make the body fall.
The barrier therefore limits the speed of the body at HEIGHT plus what the lean will add to it.
"""

import casadi as ca
import numpy as np
import typer
from cbf_clf_qp import Barrier, Clf, NumpyFunction, System, Tick
from matplotlib.figure import Figure
from rabbit_experiments.summary import mean_interval, wilson
from rl_trainer.systems import LearnedPolicy, Problem, SystemTicks, TrainingParameters, learn

LIMIT, KEPT, HEIGHT, AHEAD, RATE = 3.0, 0.01, 1.2, 4.0, 4.0  # m/s; m/s over it; m; m/s a radian of lean; 1/s
DT, TICKS, h, GRAVITY, RADIUS, WHEELS = 0.01, 800, 0.001, 9.81, 0.2, 12.0  # s; a ride; s, of a step; m/s^2; m, kg
NOMINAL, TRUE = (60, 0.8, 5.0, 1.0, 0.5), (70, 0.85, 6.5, 0.8, 1.0)  # body, kg; center, m; kg m^2; motor; drag, Nm s

body, center, inertia, motor, drag, lean = p = [ca.SX.sym(s) for s in ("body", "center", "I", "motor", "drag", "lean")]
v, theta, omega, torque = (ca.SX.sym(name) for name in ("v", "theta", "omega", "torque"))
lever, coupling = ca.vertcat(1 / RADIUS, -1), body * center * ca.cos(theta)  # drag acts between body and wheels
mass = ca.blockcat([[body + WHEELS, coupling], [coupling, inertia + body * center**2]])
forces = body * center * ca.sin(theta) * ca.vertcat(omega**2, GRAVITY) - lever * drag * (v / RADIUS - omega)
v_dot, omega_dot = ca.vertsplit(ca.inv_minor(mass) @ (forces + lever * motor * torque))
look_ahead = v + HEIGHT * ca.cos(theta) * omega + AHEAD * ca.sin(theta)

SEGWAY = System(ca.vertcat(v, theta, omega), torque, ca.vertcat(v_dot, omega, omega_dot), p)
later = SEGWAY.x + ca.vertcat(h * v_dot, (omega + h * omega_dot / 2) * h, h * omega_dot)
PLANT = NumpyFunction.of("plant", {"x": SEGWAY.x, "p": SEGWAY.p, "u": torque}, {"x": later})
BARRIER = Barrier("B", LIMIT - look_ahead, poles=(RATE,))
TICK = Tick(SEGWAY, [Clf(theta - lean, eps=0.3), BARRIER], reads={"look_ahead": look_ahead, "observation": SEGWAY.x})
UNITS = (("v", 1.5, 1.5), ("theta", 0.0, 0.2), ("omega", 0.0, 0.6))
SCALES = (1.0, 1.0), (8.0, 8.0), (1.0, 1.0)  # of alpha, beta and their error
PROBLEM = Problem("segway", 1, TICK.terms.names, ("v", "theta", "omega"), UNITS, *SCALES, mu_unit=3.0)
RIDDEN = SystemTicks(TICK, PROBLEM, DT)


def ride(seed: tuple[int, ...], policy: LearnedPolicy | str, noise: float = 0.0) -> np.ndarray:
    """Look-ahead and wheels' speed (TICKS, 2) of a true ride, m/s; inf after a fall. "nominal", "oracle": no policy."""
    rng, speeds = np.random.default_rng(seed), np.full((TICKS, 2), np.inf)
    x, lean, turn = rng.uniform((0, -0.05, 0), (1.5, 0.05, 0)), rng.uniform(0.1, 0.2), rng.integers(300, 450)
    RIDDEN.begin(policy if isinstance(policy, LearnedPolicy) else None, np.array(TRUE) if policy == "oracle" else None)
    for k in range(TICKS):  # the rider leans forward, back for a second, and forward again
        p = np.array([*NOMINAL, -lean if turn < k < turn + 100 else lean])
        now = RIDDEN(x, p, noise * rng.standard_normal(1))
        speeds[k] = now.seen.look_ahead[0], x[0]
        for _ in range(round(DT / h)):
            x = PLANT(x, np.array([*TRUE, p[-1]]), now.control).x
        if abs(x[1]) > 1:
            break
    return speeds


def train(seed: int, learner: str = "regression", episodes: int = 4) -> LearnedPolicy:
    """Ride with the present estimates and noise, learn from what was measured, repeat."""
    slow = {"actor_rate": 6e-4, "critic_rate": 1e-3, "polyak": 5e-4, "batch": 160, "hidden1": 64, "hidden2": 64}
    rides = {"sigma": 2, "sigma_factors": (1,), "nominal_episodes": 1, "updates_per_tick": 0, "updates_least": 600}
    asked = {"problem": PROBLEM, "seed": seed, "learner": learner, "episodes": episodes}
    parameters = TrainingParameters.model_validate({**slow, **rides, **asked})
    return learn(parameters, RIDDEN, lambda policy, plan: ride((seed, 0, plan.episode), policy, plan.sigma))


def main(seeds: int = 5, learner: str = "regression", picture: str = "") -> None:
    """So many trainings, with `regression` or `ddpg`; the picture, a file, is of the first test ride."""
    axes = (figure := Figure(figsize=(7, 3.2), layout="constrained")).subplots()
    print("over the limit, m/s: mean of the trainings' worst rides [95%], worst, wheels; rides that kept it [95%]")
    learned: list[LearnedPolicy | str] = [train(seed, learner) for seed in range(1, seeds + 1)]
    for name, each in (("nominal", ["nominal"]), ("learned", learned), ("oracle", ["oracle"])):
        tests = [[ride((s, 1, k), each[i % len(each)]) for k in range(10)] for i, s in enumerate(range(1, seeds + 1))]
        over, wheels = np.moveaxis(np.max(tests, axis=2) - LIMIT, 2, 0)
        worst, kept = over.max(1), int((over <= KEPT).sum())
        mean, share = np.round(mean_interval(worst) or np.nan, 4), np.round(wilson(kept, over.size), 2)
        print(f"{name} {worst.mean():.4f} {mean} {worst.max():.4f} {wheels.max():.3f}; {kept} of {over.size} {share}")
        axes.plot(DT * np.arange(TICKS), tests[0][0][:, 0], label=name, linewidth=5 - 1.7 * len(axes.lines))
    axes.axhline(LIMIT, color="black", linestyle="--", label="limit")
    axes.set(xlabel="time (s)", ylabel="look-ahead speed (m/s)")
    axes.legend()
    if picture:
        figure.savefig(picture, dpi=120)


if __name__ == "__main__":
    typer.run(main)
