"""One tick with numbers, for docs/worked_tick.md: B1 keeps the swing foot before the stone's far edge."""

from collections.abc import Iterable

from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters

TICK = 86


def line(name: str, values: Iterable[float] | float) -> None:
    """A name and its values in three digits."""
    numbers = values if isinstance(values, Iterable) else [values]
    print(f"{name:22}", " ".join(f"{float(value):9.3g}" for value in numbers))


parameters = load_parameters("ours", controller="rl-cbf-clf-qp")
heavy = SimulationParameters(mass_scale=2.0, motor_lag=0.004)
simulation, controller = Assembly(heavy, parameters, resolve_policy(None, parameters)).build()
state = simulation.reset(1)
controller.reset(1)
for _ in range(TICK):
    state = simulation.step(controller.step(state).torque)
tick, poles = controller.step(state), (parameters.barrier_pole_1, parameters.barrier_pole_2)
mu, (B1, _), (dB1, _) = tick.mu_qp, tick.barriers, tick.barrier_rates
nominal, error = tick.nominal_a @ mu + tick.nominal_b, tick.alpha @ mu + tick.beta

line("y (rad)", tick.eta[:4])
line("y' (rad/s)", tick.eta[4:])
line("V", tick.V)
line("B1 (m), B1'", (B1, dB1))
line("nominal B1'' at mu = 0", tick.nominal_b[1])
line("its factor of mu", tick.nominal_a[1])
line("beta of B1''", tick.beta[1])
line("alpha of B1''", tick.alpha[1])
line("-K_b (B1, B1')", -poles[0] * poles[1] * B1 - sum(poles) * dB1)
line("mu (rad/s^2)", mu)
line("B1'' nominal, error", (nominal[1], error[1]))
line("B1'' estimated", nominal[1] + error[1])
line("slack d", tick.clf_slack)
line("torque (N m)", tick.torque)
print("rows with equality    ", " ".join(tick.active))
simulation.close()
