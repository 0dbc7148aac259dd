"""How fast N robots walk in MuJoCo, and what each part costs: CPU time of one process, so on a busy machine too.

the bare rollout      `mujoco.rollout` once more with the same states, torques, substeps and sensors, and nothing else
a batch's tick        plants and controllers of all robots; one whose episode ends begins another
evaluation            whole seeded runs with their figures, one at a time and in a batch
memory                of the process, after a tenth of the ticks and at the end
"""

import resource
import time
from typing import Any

import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_experiments.assembly import Assembly, make_simulation
from rabbit_experiments.evaluation import episode_seeds, parts, walk, walk_together
from rabbit_sim.batch_simulation import BatchSimulation
from rl_cbf_clf_controller.batch_controller import BatchController

BARE_EVERY = 5  # ticks between two measures of the bare rollout
WARM_UP = 20  # ticks not counted
ALONE = 4  # runs that are walked one at a time


class TimedRollout:
    """A `mujoco.rollout.Rollout` that notes its CPU seconds; where `again`, those of doing the same once more."""

    def __init__(self, rollout: Any) -> None:
        self._rollout, self.again = rollout, False
        self.seconds, self.bare = list[float](), list[float]()

    def rollout(self, *given: Any, **options: Any) -> None:
        """See `Rollout`."""
        start = time.process_time()
        self._rollout.rollout(*given, **options)
        self.seconds.append(time.process_time() - start)
        if self.again:
            start = time.process_time()
            self._rollout.rollout(*given, **options)
            self.bare.append(time.process_time() - start)


def bench_batch(assembly: Assembly, robots: int, ticks: int, seed: int) -> dict[str, Any]:
    """`ticks` are of all robots together. Microseconds of CPU a robot and tick, and ratios."""
    gait = load_gaits(assembly.controller.gait)
    seeds = list(episode_seeds(seed, robots).values())
    figures = walk_on(assembly, robots, ticks, seeds, gait)
    with parts(assembly) as (_, controller):  # made before the clock starts, as a process makes them once
        pass
    start = time.process_time()
    alone = [walk(assembly, run, episode).row.ticks for run, episode in enumerate(seeds[:ALONE])]
    one = (time.process_time() - start) / sum(alone)
    start = time.process_time()
    lengths = [result.row.ticks for _, result in walk_together(controller, [assembly] * robots, range(robots), seeds)]
    many = (time.process_time() - start) / sum(lengths)
    figures["us"] |= {"evaluation, one run at a time": one * 1e6, "evaluation, in a batch": many * 1e6}
    figures["ratios"]["evaluation in a batch, times as fast"] = one / many
    return figures


def walk_on(assembly: Assembly, robots: int, ticks: int, seeds: list[int], gait: Any) -> dict[str, Any]:
    """Robots that walk, and begin again where an episode ends."""
    with parts(assembly) as (_, controller):
        many = BatchController(controller, [assembly.make_policy()] * robots)
    batch = BatchSimulation([make_simulation(assembly.simulation, gait) for _ in range(robots)])
    states = batch.reset(seeds)
    for i, seed in enumerate(seeds):
        many.reset(i, seed)
    timed: Any = TimedRollout(batch._rollout)
    batch._rollout = timed
    seconds, memory, rng = list[float](), list[int](), np.random.default_rng(seeds[0])
    for tick in range(WARM_UP + -(-ticks // robots)):
        timed.again = not tick % BARE_EVERY
        before, start = len(timed.bare), time.process_time()
        output = many.step(states)
        states = batch.step(output.torque)
        ended = ~states.running
        ended[[*output.faults, *output.errors]] = True
        for i in ended.nonzero()[0].tolist():
            seed = int(rng.integers(2**32))
            batch.restart(i, batch.simulations[i], seed)
            many.reset(i, seed)
        seconds.append(time.process_time() - start - sum(timed.bare[before:]))
        memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    counted, inside = np.array(seconds[WARM_UP:]), np.array(timed.seconds[WARM_UP:])
    us = {
        "a batch's tick": float(counted.mean()) / robots * 1e6,
        "the rollout in it": float(inside.mean()) / robots * 1e6,
        "the bare rollout": float(np.mean(timed.bare[WARM_UP // BARE_EVERY :])) / robots * 1e6,
    }
    return {
        "robots": robots,
        "robot_ticks": len(counted) * robots,
        "us": us,
        "memory_mb": {"after a tenth": memory[len(memory) // 10] / 1024, "at the end": memory[-1] / 1024},
        "ratios": {"a batch's rate / the bare rollout's": us["the bare rollout"] / us["a batch's tick"]},
    }
