"""One walk through the node graph: start the nodes, wait until they are matched, let them walk, end them.

`make_graph` says who walks, with which parameters; `rabbit walk` and walk.launch.py start the nodes that it names.

FOLDER/parameters.yaml   what every node was told (a ROS parameter file)
FOLDER/recording/        the recording
FOLDER/log/              what each node printed, unless `ros2 launch` shows it
FOLDER/summary.json, records.npz, pictures/, walk.mp4, walk.gif    made from the recording afterwards
"""

import contextlib
import json
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from rabbit_cli import exit_codes
from rabbit_cli.executables import NAMESPACE, LaunchError
from rabbit_cli.threads import use_one_thread
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.live.parameters import PORT
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_bringup.launching.parameter_file import write_parameters
from rabbit_bringup.launching.processes import PACKAGES, NodeSpec, Processes

GLANCE_SECONDS = 0.2  # between two looks at the walk
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
STORAGES = {"true": "mcap", "1": "mcap", "false": "none", "0": "none"}


def _storage(value: object) -> str:
    """A truth value, as launch files have it, in place of a format."""
    text = str(value).strip().lower()
    return STORAGES.get(text, text)


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
    record: Annotated[Literal["mcap", "sqlite3", "none"], BeforeValidator(_storage)] = Field(
        "mcap", description="format of the recording; true is mcap, false none"
    )
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
    log_level: Literal["debug", "info", "warn", "error", "fatal"] = Field("info", description="of all nodes")
    params_file: Path | None = Field(
        None, description="ROS parameter file; its values count where no option says otherwise"
    )


class Walk(BaseModel):
    """What is known of a walk before it begins."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    folder: Path
    options: WalkOptions
    simulation: SimulationParameters
    controller: ControllerParameters


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
        self.code = exit_codes.of_signal(number)


class Stuck(LaunchError):
    """The graph runs, and cannot go on."""

    code = exit_codes.ExitCode.FAULT


def make_graph(
    folder: Path,
    options: WalkOptions,
    simulation: SimulationParameters,
    controller: ControllerParameters,
    policy: str,
    training: dict[str, Any] | None = None,
    further: Mapping[str, dict[str, Any]] = MappingProxyType({}),
) -> Graph:
    """Who walks: simulator and controller; the trainer, under the parameters `training`, and the recorder if wanted.

    `further`: parameters by node that none of the others decides.
    """
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
    wanted = ["simulator", "controller", *["trainer"] * options.trainer, *["recorder"] * (options.record != "none")]
    wanted += ["viewer"] * options.view
    remaps = ["-r", "/clock:=clock", "-r", f"__ns:=/{options.namespace.strip('/')}", "--log-level", options.log_level]
    arguments = ("--ros-args", "--params-file", str(folder / "parameters.yaml"), *remaps, "--enclave")
    nodes = {name: NodeSpec(PACKAGES[name], name, (*arguments, f"/rabbit/{name}")) for name in wanted}
    parameters = {name: {**further.get(name, {}), **told[name]} for name in wanted}
    return Graph(folder, options.namespace, nodes, parameters)


def run_graph(
    graph: Graph, options: WalkOptions, show: Callable[[Any], None], ended: Callable[[Any], None] = lambda _: None
) -> tuple[list[Any], float]:
    """Walk all episodes; returns their last `Episode` messages and the wall seconds that they took.

    All nodes have ended when this returns or raises.

    Args:
        graph: who walks.
        options: how.
        show: gets the watch's `Progress` now and then.
        ended: gets the `Episode` message of each episode that has ended.

    Raises:
        LaunchError: another graph is there; a node cannot be started, ended by itself, or is not ready in time.
        Interrupted: by a signal.
    """
    use_one_thread()
    from rabbit_cli.ros.namespace_check import NamespaceCheck

    from rabbit_bringup.ros.priority import listening_to

    with _signals_raise(), contextlib.closing(NamespaceCheck(graph.namespace)) as claim, listening_to(options.priority):
        claim.look(graph.names)
        write_parameters(graph.folder / "parameters.yaml", graph.parameters)
        processes = Processes(graph.folder / "log")
        try:
            for node in graph.nodes.values():
                processes.start(node)
            return _follow(graph.names, options, processes, show, ended)
        finally:
            _end(processes)


def follow_launched(
    folder: Path, pids: Mapping[str, int], options: WalkOptions, ended: Callable[[Any], None]
) -> tuple[list[Any], float]:
    """As `run_graph`, with nodes that another process has started: their process ids, by name."""
    with _signals_raise():
        processes = Processes(folder / "log")
        try:
            for name, pid in pids.items():
                processes.adopt(name, pid)
            return _follow(list(pids), options, processes, lambda _: None, ended)
        finally:
            _end(processes, may_hurry=False)  # `ros2 launch` has a patience of its own, and sends SIGINT twice


def _follow(
    names: list[str],
    options: WalkOptions,
    processes: Processes,
    show: Callable[[Any], None],
    ended: Callable[[Any], None],
) -> tuple[list[Any], float]:
    """See a graph through its walk."""
    from rabbit_bringup.ros.walk_monitor import WalkMonitor

    with contextlib.closing(WalkMonitor(options.namespace, ended)) as watch:
        _wait_until_ready(names, watch, processes, options.ready_timeout)
        _walk(watch, processes, options, show)
        return list(watch.ended.values()), watch.seconds


def _wait_until_ready(names: list[str], watch: Any, processes: Processes, timeout: float) -> None:
    deadline = time.monotonic() + timeout
    while missing := watch.not_ready(names):
        processes.check()
        if time.monotonic() > deadline:
            lines = "; ".join(f"{name}: {line}" for name, line in missing.items())
            raise LaunchError(f"not ready after {timeout:g} s: {lines}")
        watch.spin(0.05)
    if not watch.begin():
        raise LaunchError("the simulator does not answer its pause service")


def _walk(watch: Any, processes: Processes, options: WalkOptions, show: Callable[[Any], None]) -> None:
    """An episode that an operator asks for takes the place of the one that it cuts short."""
    learns_between = options.trainer and options.swap_at == "episode"
    while not watch.is_over(options.episodes) or (learns_between and watch.digested < watch.episode.episode):
        watch.spin(GLANCE_SECONDS)
        show(watch.progress())
        processes.check()
        if watch.complaint:
            raise Stuck(watch.complaint)


def _end(processes: Processes, may_hurry: bool = True) -> None:
    """End all nodes, those that others listen to first; a further signal ends them at once."""

    def hurry(number: int, frame: object) -> None:
        processes.hurry = may_hurry

    for number in ENDING:
        signal.signal(number, hurry)
    processes.stop(("simulator", "controller"))
    processes.stop(("trainer",))
    processes.stop()


@contextlib.contextmanager
def _signals_raise() -> Iterator[None]:
    def stop(number: int, frame: object) -> None:
        raise Interrupted(number)

    before = {number: signal.signal(number, stop) for number in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
