"""What the barriers promise, on walks: each step begins where they promise something, and the foot stays inside."""

from collections.abc import Callable

import numpy as np
import pytest
from rabbit_experiments.assembly import Assembly, resolve_policy
from rl_trainer.rollout import Record, rollout

MakeAssembly = Callable[..., Assembly]
ROUNDING = 1e-9  # m


def walk(assembly: Assembly, seed: int) -> list[Record]:
    """All ticks of a walk."""
    simulation, controller = assembly.build()
    records: list[Record] = []
    rollout(simulation, controller, seed, records.append)
    simulation.close()
    return records


@pytest.mark.parametrize("plant", ["rigid", "pybullet"])
@pytest.mark.parametrize(
    ("controller", "policy", "mass_scale"),
    [("cbf-clf-qp", "zero", 1.0), ("rl-cbf-clf-qp", "oracle", 2.0), ("rl-cbf-clf-qp", "rl-cbf-clf-qp", 2.0)],
)
def test_every_step_begins_inside_and_the_foot_stays_within_the_margin(
    make_assembly: MakeAssembly, controller: str, policy: str, mass_scale: float, plant: str
) -> None:
    """With motors that lag, held torques and soft rows, B may be negative by less than the rows' margin."""
    base = make_assembly(controller, "zero", plant=plant, mass_scale=mass_scale, stones=10)
    policy = resolve_policy(policy, base.controller)
    outputs = [each.output for each in walk(Assembly(base.simulation, base.controller, policy), 9001)]
    starts = np.flatnonzero(np.diff([output.step_index for output in outputs], prepend=-1))
    B = np.array([output.barriers for output in outputs])
    rate = np.array([output.barrier_rates for output in outputs])
    assert len(starts) == 10
    assert (B[starts] >= -ROUNDING).all()
    assert (rate[starts] + base.controller.barrier_pole_1 * B[starts] >= 0).all()
    assert B.min() > -base.controller.stone_margin


@pytest.mark.parametrize("plant", ["rigid", "pybullet"])
def test_with_exact_estimates_and_motors_that_do_not_lag_no_barrier_is_negative(
    make_assembly: MakeAssembly, plant: str
) -> None:
    assembly = make_assembly("rl-cbf-clf-qp", "oracle", plant=plant, mass_scale=2.0, stones=10, motor_lag=0.0)
    B = np.array([each.output.barriers for each in walk(assembly, 9001)])
    assert B.min() >= -ROUNDING
