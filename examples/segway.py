"""A wheeled pendulum learns to keep a speed limit, the task of Taylor et al. 2020: heavier and weaker than believed.

    state x = (v, theta, omega): the wheels' speed, the lean (forward positive), its rate;  input: the motor's torque
    CLF:      y = theta - the lean that the rider asks for, relative degree 2; a soft row
    barrier:  B = LIMIT - look-ahead speed >= 0, relative degree 1; a row with a slack of last resort

To brake, the wheels must first run forward, so that the body leans back; a limit on v alone would make the body fall.
The barrier therefore limits the speed of the body at HEIGHT plus what the lean will add to it.
"""

import argparse
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.cbf import Cbf
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.io_linearization import precontrol
from cbf_clf_qp.model_error import ModelError
from cbf_clf_qp.problem import Problem
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.solvers import make_solver
from cbf_clf_qp.tick import Estimator, Recipe, Terms, decide
from matplotlib.figure import Figure
from rabbit_experiments.summary import mean_interval, wilson
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy, ZeroPolicy
from rl_trainer.parameters import TrainingParameters
from rl_trainer.system_transitions import SystemTick, transition
from rl_trainer.training import Trainer

LIMIT, KEPT, HEIGHT, AHEAD, RATE = 3.0, 0.01, 1.2, 4.0, 4.0  # m/s; m/s over it; m; m/s a radian of lean; 1/s
TICK, TICKS, SUBSTEPS, GRAVITY, RADIUS, WHEELS = 0.01, 800, 10, 9.81, 0.2, 12.0  # s; a ride; -; m/s^2; m, kg
NOISE, EPISODES, UPDATES, RIDES = 2.0, 4, 600, 10  # rad/s^2; of a training; of an episode; that test a policy
BELIEVED, TRUE = (60, 0.8, 5.0, 1.0, 0.5), (70, 0.85, 6.5, 0.8, 1.0)  # body, kg; center, m; kg m^2; motor; drag, Nm s
LEAN = np.array([[0.0, 1.0]])  # of the coordinates (position, theta)


def dynamics(segway: tuple[float, ...], x: Array) -> SimpleNamespace:
    """The `acceleration` of (v, theta), affine in the torque; drag acts between body and wheels."""
    (v, theta, omega), (body, center, inertia, motor, drag) = x, segway
    lever, coupling = np.array([1 / RADIUS, -1.0]), body * center * np.cos(theta)
    mass = np.array([[body + WHEELS, coupling], [coupling, inertia + body * center**2]])
    forces = body * center * np.sin(theta) * np.array([omega**2, GRAVITY]) - lever * drag * (v / RADIUS - omega)
    return SimpleNamespace(acceleration=Affine(motor * lever[:, None], forces).mapped(np.linalg.inv(mass)))


def after_tick(x: Array, torque: Array) -> Array:
    """The true Segway's state a tick later."""
    for _ in range(SUBSTEPS):
        v_dot, omega_dot = dynamics(TRUE, x).acceleration(torque) * TICK / SUBSTEPS
        x = x + np.array([v_dot, (x[2] + omega_dot / 2) * TICK / SUBSTEPS, omega_dot])
    return x


def scene_of(x: Array, lean: float) -> SimpleNamespace:
    """What quantities and policies read: the state, the output y = theta - lean."""
    eta = np.array([x[1] - lean, x[2]])
    outputs = SimpleNamespace(eta=eta, second_derivative=lambda ddq: ddq.mapped(LEAN))
    return SimpleNamespace(x=x, outputs=outputs, observation=x, LgV=CLF.derivative(eta).a[0])


class SpeedLimit(Cbf):
    """B = LIMIT - the look-ahead speed."""

    names = ("B",)

    def value(self, scene: SimpleNamespace) -> Array:
        v, theta, omega = scene.x
        return np.array([LIMIT - v - HEIGHT * np.cos(theta) * omega - AHEAD * np.sin(theta)])

    def derivative(self, scene: SimpleNamespace, acceleration: Affine) -> Affine:
        _, theta, omega = scene.x
        bias = HEIGHT * np.sin(theta) * omega**2 - AHEAD * np.cos(theta) * omega
        return acceleration.mapped(np.array([[-1.0, -HEIGHT * np.cos(theta)]]), bias)


BARRIER = SpeedLimit(RATE, 1e6)
CLF = ResClf(1, 0.3, (1.0, 2.0))
RECIPE, ERROR = Recipe[Any]((Clf(CLF, 10.0), BARRIER)), ModelError()
UNITS = (("v", 1.5, 1.5), ("theta", 0.0, 0.2), ("omega", 0.0, 0.6))
SCALES = (1.0, 1.0), (8.0, 8.0), (1.0, 1.0)  # of alpha, beta and their error
PROBLEM = Problem("segway", 1, RECIPE.names, ("v", "theta", "omega"), UNITS, *SCALES, mu_unit=3.0)


class Oracle(Estimator[SimpleNamespace]):
    """The true ones."""

    def estimate(self, terms: Terms[SimpleNamespace], before: Estimates) -> Estimates:
        return ERROR(terms, dynamics(TRUE, terms.scene.x))


NOMINAL = ZeroPolicy(PROBLEM)


def ride(seed: tuple[int, ...], estimator: Estimator[Any], noise: float = 0.0, trainer: Trainer | None = None) -> Array:
    """Look-ahead and wheels' speed (TICKS, 2) of a true ride, m/s; inf where it fell. The `trainer` takes its ticks."""
    recipe = replace(RECIPE, estimators=(estimator,))
    rng, solver, last, speeds = np.random.default_rng(seed), make_solver("daqp"), None, np.full((TICKS, 2), np.inf)
    x, lean, turn = rng.uniform((0, -0.05, 0), (1.5, 0.05, 0)), rng.uniform(0.1, 0.2), rng.integers(300, 450)
    for k in range(TICKS):  # the rider leans forward, back for a second, and forward again
        scene, believed = scene_of(x, -lean if turn < k < turn + 100 else lean), dynamics(BELIEVED, x)
        terms = Terms.of(RECIPE.quantities, scene, believed, precontrol(believed.acceleration.mapped(LEAN)))
        decided = decide(recipe, terms, solver)
        now = SystemTick(terms, decided, decided.mu + noise * rng.standard_normal(1), x)
        if trainer and last:
            trainer.take(transition(PROBLEM, k - 1, last, now, TICK))
        last, speeds[k], x = now, (LIMIT - BARRIER.value(scene)[0], x[0]), after_tick(x, now.control)
        if abs(x[1]) > 1:
            break
    return speeds


def train(seed: int, learner: str = "regression", episodes: int = EPISODES) -> Estimator[Any]:
    """Ride with the present estimates and noise, learn from what was measured, repeat."""
    slow = {"actor_rate": 6e-4, "critic_rate": 1e-3, "polyak": 5e-4, "batch": 160}
    p = TrainingParameters(problem=PROBLEM, seed=seed, learner=learner, hidden1=64, hidden2=64, **slow)
    trainer = Trainer(p)
    estimator: LearnedPolicy = NOMINAL
    for episode in range(episodes):
        ride((seed, 0, episode), estimator, NOISE, trainer)
        trainer.learn(UPDATES)
        estimator = ActorPolicy(trainer.policy_file())
    return estimator


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5], help="of the trainings")
    parser.add_argument("--learner", default="regression", help="or ddpg")
    parser.add_argument("--picture", help="file for a picture of the first test ride")
    asked = parser.parse_args()
    axes = (figure := Figure(figsize=(7, 3.2), layout="constrained")).subplots()
    policies: list[Estimator[Any]] = [train(seed, asked.learner) for seed in asked.seeds]
    print("over the limit, m/s: mean of the trainings' worst rides [95%], worst, wheels; rides that kept it [95%]")
    rows: dict[str, list[Estimator[Any]]] = {"nominal": [NOMINAL], "learned": policies, "oracle": [Oracle()]}
    for name, each in rows.items():
        tests = [[ride((s, 1, k), each[i % len(each)]) for k in range(RIDES)] for i, s in enumerate(asked.seeds)]
        over, wheels = np.moveaxis(np.max(tests, axis=2) - LIMIT, 2, 0)
        worst, kept = over.max(1), int((over <= KEPT).sum())
        mean, share = np.round(mean_interval(worst) or np.nan, 4), np.round(wilson(kept, over.size), 2)
        print(f"{name} {worst.mean():.4f} {mean} {worst.max():.4f} {wheels.max():.3f}; {kept} of {over.size} {share}")
        axes.plot(TICK * np.arange(TICKS), tests[0][0][:, 0], label=name, linewidth=5 - 1.7 * len(axes.lines))
    axes.axhline(LIMIT, color="black", linestyle="--", label="limit")
    axes.set(xlabel="time (s)", ylabel="look-ahead speed (m/s)")
    axes.legend()
    if asked.picture:
        figure.savefig(asked.picture, dpi=120)
