"""A walk through the node graph, before it begins: who walks, with which parameters, and what it leaves.

FOLDER/parameters.yaml   the parameters of every node (a ROS parameter file)
FOLDER/recording/        the recording
FOLDER/log/              what each node printed
FOLDER/summary.json, records.npz, pictures/, walk.mp4, walk.gif    made from the recording afterwards
"""

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import Field
from rabbit_common.executables import NAMESPACE
from rabbit_description import ABOUT_TASK
from rabbit_description.validation import Checked
from rabbit_estimator.parameters import EstimatorParameters
from rabbit_experiments.conditions import ABOUT_PARAMETERS
from rabbit_sim.parameters import Pace, SimulationParameters
from rabbit_viewer.page import PORT
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_bringup.launching.processes import PACKAGES

MOST_EPISODES = 10_000
NOBODY = "none"  # as the controller: one that is started by hand


class WalkOptions(Checked):
    """The options of `rabbit walk` besides plant and controller."""

    controller: str = Field(
        "", description="controller by name, PACKAGE/EXECUTABLE of another node, or none: you start one yourself"
    )
    task: str = Field("", description=f"walk a task in RABBIT's place: {ABOUT_TASK}")
    out: Path | None = Field(None, description="folder for all that the walk leaves (default: runs/DATE-seed-SEED)")
    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of course, first state and noise")
    episodes: int = Field(1, ge=1, le=MOST_EPISODES, description="episodes, their seeds counting up")
    policy: str | None = Field(None, description="zero, a shipped policy or a file")
    parameters: str = Field("ours", description=ABOUT_PARAMETERS)
    trainer: bool = Field(True, description="the trainer learns from each episode")
    swap_at: Literal["episode", "never"] = Field(
        "never", description="when the trainer's policies take effect; with episode it plans each episode"
    )
    record: bool = Field(True, description="record every topic")
    pictures: bool = Field(True, description="draw the walk")
    video: bool = Field(True, description="film the walk")
    real_time: bool = Field(False, description="100 Hz by the wall clock instead of lock-step")
    priority: int = Field(
        0,
        ge=0,
        le=99,
        description="SCHED_FIFO priority of simulator and controller, where permitted; of the others 10 less; 0: none",
    )
    pace: Pace | None = Field(
        None, description="lock-step: times real time at most; 0: no limit (default: 0; with --view 1)"
    )
    view: bool = Field(False, description="serve a live view beside the walk")
    view_port: int = Field(PORT, ge=0, le=65535, description="port of the live view; 0: any free one")
    namespace: str = Field("", pattern=NAMESPACE, description="namespace of the graph")
    ready_timeout: float = Field(60.0, gt=0, le=3600, description="s for the nodes to find each other")
    log_level: Literal["debug", "info", "warn", "error", "fatal"] = Field("info", description="log level of all nodes")

    @property
    def is_foreign(self) -> bool:
        """Whether another node than ours is the controller."""
        return self.controller == NOBODY or "/" in self.controller

    @property
    def learns_between(self) -> bool:
        """Whether the trainer plans each episode."""
        return self.trainer and self.swap_at == "episode"


class WalkSettings(Checked):
    """Who walks, and where it leaves what.

    `policy`: zero or a file; `training`: of the trainer; `further`: parameters by node that nothing else decides.
    """

    folder: Path
    options: WalkOptions
    simulation: SimulationParameters
    controller: ControllerParameters
    policy: str
    training: dict[str, Any] = Field(default_factory=dict)
    further: dict[str, dict[str, Any]] = Field(default_factory=dict)

    @classmethod
    def of(cls, assembly: Any, folder: Path, options: WalkOptions, **more: Any) -> "WalkSettings":
        """The settings of an `Assembly`."""
        parts = {name: getattr(assembly, name) for name in ("simulation", "controller", "policy")}
        return cls(folder=folder, options=options, **parts, **more)

    @property
    def names(self) -> list[str]:
        """The nodes: simulator and controller; an estimator if need be; trainer, recorder and viewer if wanted."""
        options = self.options
        wanted = {"controller": options.controller != NOBODY, "estimator": self.simulation.sensors == "lab"}
        wanted |= {"trainer": options.trainer, "recorder": options.record, "viewer": options.view}
        return ["simulator", *(name for name, is_wanted in wanted.items() if is_wanted)]

    def executable(self, name: str) -> tuple[str, str]:
        """Package and executable of a node."""
        if name == "controller" and self.options.is_foreign:
            package, _, executable = self.options.controller.partition("/")
            return package, executable
        return PACKAGES[name], name

    @property
    def parameter_file(self) -> Path:
        """The file from which the nodes take their parameters."""
        return self.folder / "parameters.yaml"

    def arguments(self, name: str) -> list[str]:
        """The command line of an executable. The simulator waits for the launcher; by the file alone it does not."""
        paused = ("-p", "start_paused:=true") if name == "simulator" else ()
        remaps = ("-r", "/clock:=clock", "-r", f"__ns:=/{self.options.namespace.strip('/')}")
        level, enclave = ("--log-level", self.options.log_level), ("--enclave", f"/rabbit/{name}")
        return ["--ros-args", "--params-file", str(self.parameter_file), *paused, *remaps, *level, *enclave]

    def parameters(self) -> dict[str, dict[str, Any]]:
        """The nodes' parameters, by node."""
        options, simulation, controller = self.options, self.simulation.model_dump(), self.controller.model_dump()
        of_task = {"task": options.task}
        priority, problem = {"priority": options.priority}, str(self.controller.problem)
        of_robot = {"plant": json.dumps(simulation), "policy": self.policy, "problem": problem}  # the trainer's
        by_node: dict[str, dict[str, Any]] = {
            "simulator": {
                "seed": options.seed,
                "episodes": options.episodes,
                "trainer": "ignore" if not options.trainer else "follow" if options.learns_between else "wait",
                "real_time": options.real_time,
                "pace": float(options.view) if options.pace is None else options.pace,
                **priority,
                **(of_task if options.task else {"gait": self.controller.gait, **simulation}),
            },
            "controller": {
                "policy": self.policy,
                "swap_at": options.swap_at,
                **priority,
                **(of_task if options.task else controller),
            },
            "estimator": {**priority, **EstimatorParameters.knowing(self.simulation).model_dump(exclude_unset=True)},
            "trainer": {
                "plan_episodes": options.learns_between,
                "folder": str(self.folder / "training"),
                "seed": options.seed,
                **(of_task if options.task else of_robot),
                **self.training,
            },
            "recorder": {"path": str(self.folder / "recording"), "topics": ["parameters"] if options.task else []},
            "viewer": {"port": options.view_port, "wait": 0.0},
        }
        if options.is_foreign:
            del by_node["controller"]
        return {name: {**self.further.get(name, {}), **by_node[name]} for name in self.names if name in by_node}
