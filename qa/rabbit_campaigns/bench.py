"""How long a tick, a walk and a batch take, each beside its floor in the same run: the figures of `rabbit bench`."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
from cbf_clf_qp.compiled import CACHE, COMPILE
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.evaluation import walk
from rabbit_sim.c_example import write_example
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import SUBSTEPS
from rl_cbf_clf_controller.export import export
from rl_cbf_clf_controller.parameters import load_parameters

from rabbit_campaigns.batch_bench import BARE_EVERY, WARM_UP, bench_batch
from rabbit_campaigns.peer_bench import cbfpy_ratios

ROBOTS, BATCH_TICKS = 64, 30_000
FIRST_TICK = """
import json, time
from rabbit_campaigns.bench import assembly_of
controller = assembly_of("best", "mujoco").make_controller()
start = time.perf_counter()
controller.compile(wait=True)
controller.rehearse()
print(json.dumps(time.perf_counter() - start))
"""


def assembly_of(name: str, plant: str) -> Assembly:
    """`best`, or a controller under its usual parameters with DAQP, with its own policy; at twice the mass."""
    changes = {} if name == "best" else {"controller": name, "qp_solver": "daqp"}
    parameters = load_parameters("best" if name == "best" else "ours", "stones", **changes)
    return Assembly(SimulationParameters(plant=plant, mass_scale=2.0), parameters, resolve_policy(None, parameters))


def bench(seed: int) -> dict[str, float]:
    """The figures by their keys. Times in microseconds are medians over the ticks of a walk."""
    figures = {}
    for name in ("best", "rl-cbf-clf-qp", "cbf-clf-qp"):
        figures[f"{name}.act_us"], figures[f"{name}.act_p99_us"] = act_us(assembly_of(name, "mujoco"), seed)
    with patch.dict(os.environ, {COMPILE: "0"}):
        figures["best.act_us_without_compiler"], _ = act_us(assembly_of("best", "mujoco"), seed)
    for plant in ("mujoco", "pybullet"):
        figures[f"best.walk_over_engine.{plant}"] = walk_over_engine(assembly_of("best", plant), seed)
    many = bench_batch(assembly_of("best", "mujoco"), ROBOTS, BATCH_TICKS, seed)
    evaluated, bare = (many["us"][name] for name in ("evaluation, in a batch", "the bare rollout"))
    figures["best.walk_over_engine.mujoco_batch"] = evaluated / bare
    figures["best.batch_share"] = many["ratios"]["a batch's rate / the bare rollout's"]
    figures |= exported_tick(assembly_of("best", "mujoco"), seed) | first_tick_seconds()
    return figures | cbfpy_ratios()


def ticks_of(assembly: Assembly, seed: int) -> Iterator[tuple[Any, float]]:
    """The ticks of a walk, compiled where allowed: the plant as each begins, and the time of `Controller.act`, s."""
    simulation, controller = assembly.build()
    controller.compile(wait=True)
    with closing(simulation):
        state = simulation.reset(seed)
        controller.reset(seed)
        while state.running:
            start = time.perf_counter()
            acted = controller.act(state)
            yield simulation.plant, time.perf_counter() - start
            if acted.fault:
                break
            state = simulation.step(acted.torque)


def act_us(assembly: Assembly, seed: int) -> tuple[float, float]:
    """`Controller.act` of the ticks of a walk: median and p99."""
    times = np.array([seconds for _, seconds in ticks_of(assembly, seed)])
    median, high = np.percentile(times[WARM_UP:] * 1e6, [50, 99])
    return float(median), float(high)


def walk_over_engine(assembly: Assembly, seed: int) -> float:
    """A tick of an evaluated walk over the bare engine's substeps of a tick from the same states."""
    walk(assembly, 0, seed)  # what is made once is made
    start = time.perf_counter()
    ticks = walk(assembly, 0, seed).row.ticks
    return (time.perf_counter() - start) / ticks / bare_seconds(assembly, seed)


def bare_seconds(assembly: Assembly, seed: int) -> float:
    """Median time of a tick's substeps, once more from where the plant stands now and then."""
    plants = enumerate(ticks_of(assembly, seed))
    return float(np.median([bare_steps(plant) for tick, (plant, _) in plants if tick % BARE_EVERY == 0]))


def bare_steps(plant: Any) -> float:
    """The time of ten bare steps from where the plant stands, s; it is there again afterwards."""
    if (client := getattr(plant, "_client", None)) is not None:
        state, start = client.saveState(), time.perf_counter()
        for _ in range(SUBSTEPS):
            client.stepSimulation()
        seconds = time.perf_counter() - start
        client.restoreState(state)
        client.removeState(state)
        return seconds
    import mujoco

    scratch = mujoco.MjData(plant.model)
    mujoco.mj_copyData(scratch, plant.model, plant._data)
    start = time.perf_counter()
    for _ in range(SUBSTEPS):
        mujoco.mj_step(plant.model, scratch)
    return time.perf_counter() - start


def exported_tick(assembly: Assembly, seed: int) -> dict[str, float]:
    """Median and worst tick of the exported C, over a million ticks of a walk."""
    simulation, controller = assembly.build()
    with TemporaryDirectory() as folder, closing(simulation):
        export(controller, Path(folder))
        write_example(Path(folder), simulation, seed)
        subprocess.run(["make", "-s"], cwd=folder, check=True)
        output = subprocess.run(["./example", "--bench"], cwd=folder, check=True, stdout=subprocess.PIPE).stdout
    return {f"export.{name}": json.loads(output)[name] for name in ("tick_us", "worst_us")}


def first_tick_seconds() -> dict[str, float]:
    """The first tick of a process with an empty cache of compiled functions, and that of the next process."""
    with TemporaryDirectory() as folder:
        environment = {**os.environ, CACHE: folder}
        command = [sys.executable, "-c", FIRST_TICK]
        runs = [subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE) for _ in range(2)]
        seconds = [json.loads(run.stdout) for run in runs]
    return {"first_tick_s.cold": seconds[0], "first_tick_s.warm": seconds[1]}
