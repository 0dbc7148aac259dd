"""The graph that faults come into: simulator, controller, trainer and recorder, and a witness that hears them all."""

import os
import resource
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rabbit_bringup.launching.parameter_file import write_parameters
from rabbit_bringup.launching.processes import PACKAGES, PATIENCE, NodeSpec, Processes
from rabbit_cli.executables import LaunchError
from rabbit_cli.threads import use_one_thread
from rl_trainer.parameters import TrainingParameters

from rabbit_campaigns.faults.plan import NODES, SECOND

POLL_SECONDS = 0.02
ANSWER_TIMEOUT, TRAINER_TIMEOUT = 2.0, 60.0  # s
PACE = 0.1  # times real time: most of the processor is for nodes that begin
SECOND_NODE = SECOND.replace(" ", "_")
READERS = 4  # of the state: controller, trainer, recorder, witness; a simulator that comes back waits for them all
TRAINING = TrainingParameters(
    hidden1=16, hidden2=16, batch=16, updates_least=5, updates_per_tick=0.05, capacity=60_000, nominal_episodes=1
)


class Hang(Exception):
    """Something did not happen in time."""


class Graph:
    """The running nodes, each of which may be ended and started again. `hang_after`: s in which everything happens."""

    def __init__(self, folder: Path, namespace: str, seed: int, hang_after: float) -> None:
        """Raises: `LaunchError`: a node cannot be started."""
        use_one_thread()
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        from rabbit_campaigns.ros.graph_monitor import GraphMonitor

        self.folder, self.hang_after = folder, hang_after
        self.training = folder / "training"
        folder.mkdir(parents=True)
        write_parameters(folder / "parameters.yaml", parameters(folder, seed))
        ros = ("--params-file", str(folder / "parameters.yaml"), "-r", f"__ns:=/{namespace}", "-r", "/clock:=clock")
        self._specs = {n: NodeSpec(PACKAGES[n], n, ("--ros-args", *ros)) for n in NODES}
        second = ("-p", f"path:={folder / 'second' / 'recording'}", *ros[2:], "-r", f"__node:={SECOND_NODE}")
        self._specs[SECOND] = NodeSpec(PACKAGES["recorder"], "recorder", ("--ros-args", *second))
        self.witness = GraphMonitor(namespace)
        self._processes, self._second = Processes(folder / "log"), Processes(folder / "second" / "log")
        for name in NODES:
            self.start(name)

    def close(self) -> None:
        """End all nodes."""
        self._processes.stop(("simulator", "controller"))
        self._processes.stop()
        self._second.stop()
        self.witness.close()

    def start(self, name: str) -> None:
        """Start a node, again or for the first time."""
        self._of(name).start(self._specs[name])

    def kill(self, name: str) -> None:
        """SIGKILL."""
        self._of(name).kill((self._specs[name].executable,))

    def terminate(self, name: str) -> None:
        """SIGTERM, and wait; raises `Hang` if it has to be killed."""
        self._send(name, signal.SIGTERM)
        began = time.monotonic()
        self._of(name).stop((self._specs[name].executable,))
        if time.monotonic() - began > PATIENCE:
            raise Hang(f"the {name} does not end within {PATIENCE:g} s of a SIGTERM")

    def hold(self, name: str) -> None:
        """SIGSTOP."""
        self._send(name, signal.SIGSTOP)

    def let_go(self, name: str) -> None:
        """SIGCONT."""
        self._send(name, signal.SIGCONT)

    def fill_disk(self, name: str) -> None:
        """No file of the node may grow any more."""
        resource.prlimit(self._processes.pid(name), resource.RLIMIT_FSIZE, (0, 0))

    def wait(self, what: str, until: Callable[[], bool]) -> float:
        """Seconds until something holds.

        Raises:
            Hang: after `hang_after` s.
            LaunchError: a node ended by itself.
        """
        began = time.monotonic()
        while not until():
            self._processes.check()
            self._second.check()
            if time.monotonic() - began > self.hang_after:
                raise Hang(f"not within {self.hang_after:g} s: {what}")
            time.sleep(POLL_SECONDS)
        return time.monotonic() - began

    def recording(self) -> Path | None:
        """Where the recorder that was heard last writes to."""
        said = self.witness.said.get("recorder")
        paths = [value.value for value in said.values if value.key == "path"] if said else []
        return Path(paths[-1]) if paths else None

    def recorded(self) -> tuple[int, int]:
        """Episode and tick of the newest state that the recorder says it has."""
        said = self.witness.said.get("recorder")
        turns = [value.value.split(" ") for value in said.values if value.key == "episode, tick"] if said else []
        return (int(turns[-1][0]), int(turns[-1][1])) if turns else (0, -1)

    def newest_recording(self, name: str) -> Path:
        """The recording that a recorder begun last; raises `LaunchError` if there is none."""
        home = self.folder / "second" if name == SECOND else self.folder
        made = [path for path in home.glob("recording*") if not path.name.endswith("-recovered")]
        if not made:
            raise LaunchError(f"no recording in {home}")
        return max(made, key=lambda path: int(path.name.partition("-")[2] or 1))

    def _of(self, name: str) -> Processes:
        return self._second if name == SECOND else self._processes

    def _send(self, name: str, number: int) -> None:
        os.kill(self._of(name).pid(self._specs[name].executable), number)


def parameters(folder: Path, seed: int) -> dict[str, dict[str, Any]]:
    """What the nodes are told: short walks without end, learned from between them."""
    plant = {"motor_lag": 0.004, "mass_scale": 1.2, "stones": 3, "stop_at_miss": False}
    own = {"seed": seed, "episodes": 1_000_000, "readers": READERS, "trainer": "follow", "pace": PACE}
    own |= {"answer_timeout": ANSWER_TIMEOUT, "trainer_timeout": TRAINER_TIMEOUT}
    return {
        "simulator": {**own, **plant, "memory": str(folder / "simulator.memory")},
        "controller": {"controller": str(TRAINING.problem), "swap_at": "episode"},
        "trainer": {"plan_episodes": True, "folder": str(folder / "training"), **TRAINING.model_dump(mode="json")},
        "recorder": {"path": str(folder / "recording")},
    }
