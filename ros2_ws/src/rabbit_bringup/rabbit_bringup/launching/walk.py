"""One walk through the node graph: start the nodes, wait until they are matched, let them walk, end them, tell.

FOLDER/parameters.yaml   what every node was told (a ROS parameter file)
FOLDER/recording/        the recording
FOLDER/log/              what each node printed
FOLDER/summary.json, records.npz, pictures/, walk.mp4, walk.gif    made from the recording afterwards
"""

import contextlib
import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_bringup.launching.executables import NAMESPACE, LaunchError
from rabbit_bringup.launching.parameter_file import write_parameters
from rabbit_bringup.launching.processes import NodeSpec, Processes
from rabbit_bringup.viewing.live.parameters import PORT

GLANCE_SECONDS = 0.2  # between two looks at the walk
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class WalkOptions(BaseModel):
    """What `rabbit walk` is told besides plant and controller."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    out: Path | None = Field(None, description="folder for all that the walk leaves (default: runs/DATE-seed-SEED)")
    seed: int = Field(1, ge=0, le=2**63 - 1, description="of course, first state and noise")
    episodes: int = Field(1, ge=1, le=10_000, description="episodes, their seeds counting up")
    policy: str | None = Field(None, description="zero, a shipped policy or a file")
    parameters: str = Field("ours", description="of the controller: ours, authors or a YAML file")
    trainer: bool = Field(True, description="the trainer learns beside the walk")
    training: Path | None = Field(None, description="YAML file of training parameters")
    swap_at: Literal["auto", "tick", "episode", "never"] = Field(
        "auto",
        description="when the trainer's policies take effect; with episode it also plans each episode; "
        "auto: tick for a controller that learns, else never",
    )
    record: Literal["mcap", "sqlite3", "none"] = Field("mcap", description="format of the recording")
    pictures: bool = Field(True, description="draw the walk")
    video: bool = Field(True, description="film the walk")
    real_time: bool = Field(False, description="100 Hz by the wall clock instead of lock-step")
    priority: int = Field(
        0,
        ge=0,
        le=99,
        description="SCHED_FIFO priority of simulator and controller, where permitted; of the others 10 less; 0: none",
    )
    pace: float | None = Field(
        None, ge=0, le=100, description="lock-step: times real time at most; 0: no limit (default: 0; with --view 1)"
    )
    view: bool = Field(False, description="serve a live view beside the walk")
    view_port: int = Field(PORT, ge=0, le=65535, description="of the live view; 0: any free one")
    namespace: str = Field("", pattern=NAMESPACE, description="of the graph")
    ready_timeout: float = Field(60.0, gt=0, le=3600, description="s for the nodes to find each other")


@dataclass(frozen=True)
class Graph:
    """The nodes of a walk and what each is told."""

    folder: Path
    namespace: str
    nodes: dict[str, NodeSpec]
    parameters: dict[str, dict[str, Any]]

    @property
    def names(self) -> list[str]:
        """The nodes by name."""
        return list(self.nodes)


class Interrupted(BaseException):
    """A signal asked the launcher to end."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.code = 128 + number


def make_graph(
    folder: Path,
    options: WalkOptions,
    simulation: SimulationParameters,
    controller: ControllerParameters,
    policy: str,
    training: dict[str, Any] | None = None,
) -> Graph:
    """Who walks: simulator and controller; the trainer, under the parameters `training`, and the recorder if wanted."""
    learns_between = options.trainer and options.swap_at == "episode"
    plant = simulation.model_dump()
    auto = "tick" if controller.learns else "never"
    swap_at = auto if options.swap_at == "auto" else options.swap_at
    learner = {"plan_episodes": learns_between, "folder": str(folder / "training"), "plant": json.dumps(plant)}
    learner |= {"policy": policy, "problem": str(controller.problem), "seed": options.seed}
    trainer = "ignore" if not options.trainer else "follow" if learns_between else "wait"
    own = {"seed": options.seed, "episodes": options.episodes, "start_paused": True, "trainer": trainer}
    own["memory"] = str(folder / "simulator.memory")
    pace = {"real_time": options.real_time, "pace": float(options.view) if options.pace is None else options.pace}
    told = {
        "simulator": {**own, **pace, "priority": options.priority, "gait": controller.gait, **simulation.model_dump()},
        "controller": {"policy": policy, "swap_at": swap_at, "priority": options.priority, **controller.model_dump()},
        "trainer": {**learner, **(training or {})},
        "recorder": {"path": str(folder / "recording"), "storage": options.record},
        "viewer": {"port": options.view_port, "wait": 0.0},
    }
    packages = {"simulator": "rabbit_sim", "controller": "rl_cbf_clf_controller", "trainer": "rl_trainer"}
    wanted = ["simulator", "controller", *["trainer"] * options.trainer, *["recorder"] * (options.record != "none")]
    wanted += ["viewer"] * options.view
    remaps = ["-r", "/clock:=clock", "-r", f"__ns:=/{options.namespace.strip('/')}", "--log-level", "warn"]
    arguments = ("--ros-args", "--params-file", str(folder / "parameters.yaml"), *remaps, "--enclave")
    nodes = {
        name: NodeSpec(packages.get(name, "rabbit_bringup"), name, (*arguments, f"/rabbit/{name}")) for name in wanted
    }
    return Graph(folder, options.namespace, nodes, {name: told[name] for name in wanted})


def run_graph(graph: Graph, options: WalkOptions, show: Callable[[Any], None]) -> tuple[list[Any], float]:
    """Walk all episodes; returns their last `Episode` messages and the wall seconds that they took.

    All nodes have ended when this returns or raises.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
        Interrupted: by a signal.
    """
    write_parameters(graph.folder / "parameters.yaml", graph.parameters)
    for name in THREADS:
        os.environ.setdefault(name, "1")
    from rabbit_bringup.launching.priority_node import listening_to

    with _signals_raise(), listening_to(options.priority):
        processes = Processes(graph.folder / "log")
        watch = None
        try:
            for node in graph.nodes.values():
                processes.start(node)
            from rabbit_bringup.launching.watch_node import Watch

            watch = Watch(graph.namespace)
            _wait_until_ready(graph, watch, processes, options.ready_timeout)
            _walk(watch, processes, options, show)
            return list(watch.ended.values()), watch.seconds
        finally:
            _end(processes)
            if watch is not None:
                watch.close()


def _wait_until_ready(graph: Graph, watch: Any, processes: Processes, timeout: float) -> None:
    deadline = time.monotonic() + timeout
    while missing := watch.not_ready(graph.names):
        processes.check()
        if time.monotonic() > deadline:
            lines = "; ".join(f"{name}: {line}" for name, line in missing.items())
            raise LaunchError(f"not ready after {timeout:g} s: {lines}")
        watch.spin(0.05)
    if not watch.begin():
        raise LaunchError("the simulator does not answer its pause service")


def _walk(watch: Any, processes: Processes, options: WalkOptions, show: Callable[[Any], None]) -> None:
    learns_between = options.trainer and options.swap_at == "episode"
    while len(watch.ended) < options.episodes or (learns_between and watch.digested < options.episodes):
        watch.spin(GLANCE_SECONDS)
        processes.check()
        if watch.complaint:
            raise LaunchError(watch.complaint)
        show(watch.progress())


def _end(processes: Processes) -> None:
    """End all nodes, those that others listen to first; a further signal ends them at once."""

    def hurry(number: int, frame: object) -> None:
        processes.hurry = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, hurry)
    processes.stop(("simulator", "controller"))
    processes.stop(("trainer",))
    processes.stop()


@contextlib.contextmanager
def _signals_raise() -> Iterator[None]:
    def stop(number: int, frame: object) -> None:
        raise Interrupted(number)

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
