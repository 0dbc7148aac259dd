"""The same walk through the node graph: simulator and controller in lock-step, nothing recorded."""

from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rabbit_bringup.launching.walk import WalkOptions, make_graph, run_graph
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import Assembly

REAL_TIME_LIMIT = 5.0  # times real time


def bench_nodes(assembly: Assembly, seed: int) -> dict[str, Any] | None:
    """Ticks and wall seconds of a walk; None without ROS, or with the oracle, which no node has.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
    """
    if find_spec("rclpy") is None or assembly.policy == "oracle":
        return None
    options = WalkOptions.model_validate({"seed": seed, "trainer": False, "record": "none"})
    with TemporaryDirectory() as folder:
        graph = make_graph(Path(folder), options, assembly.simulation, assembly.controller, assembly.policy)
        ended, seconds = run_graph(graph, options, lambda now: None)
    ticks = sum(int(episode.tick) for episode in ended)
    factor = ticks * TICK_SECONDS / seconds
    return {"ticks": ticks, "wall_seconds": seconds, "real_time_factor": factor, "ratio": factor / REAL_TIME_LIMIT}
