"""The services of docker/compose.yaml, started by their own commands without Docker, walk and record together."""

import os
import re
import shlex
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rabbit_msgs.msg import Episode
from rabbit_recording.reader import iterate_episodes

ROOT = Path(__file__).resolve().parents[2]
CHANGED = {"port 8765": "port 0", "0.0.0.0": "127.0.0.1", "pace:=1.0": "pace:=0.0"}
MEMORY = "/dev/shm"  # of `ground`
PATIENCE = 180.0  # s


class Services:
    """The services' commands as processes in one folder, by name."""

    def __init__(self, folder: Path, episodes: int) -> None:
        self._folder = folder
        text = re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", (ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8"))
        for word, other in {**CHANGED, MEMORY: str(folder / "memory")}.items():
            assert word in text
            text = text.replace(word, other)
        walking = {name: of for name, of in yaml.safe_load(text)["services"].items() if "profiles" not in of}
        self._commands = {name: service["command"] for name, service in walking.items()}
        self._commands["simulator"] += f" -p stones:=3 -p episodes:={episodes}"
        del self._commands["ground"]
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, *names: str) -> None:
        """Start those, or all."""
        for name in names or self._commands:
            command, environment = shlex.split(self._commands[name]), {**os.environ, "OMP_NUM_THREADS": "1"}
            self._running[name] = subprocess.Popen(command, cwd=self._folder, env=environment)

    def kill(self, *names: str) -> None:
        """Kill those, or all."""
        for name in names or tuple(self._running):
            process = self._running.pop(name)
            process.kill()
            process.wait()

    def end(self) -> dict[str, int]:
        """Tell all to end, and wait; their exit codes."""
        for process in self._running.values():
            process.send_signal(signal.SIGTERM)
        end = time.monotonic() + PATIENCE
        return {name: process.wait(end - time.monotonic()) for name, process in self._running.items()}


@pytest.fixture
def services(tmp_path: Path) -> Iterator[Services]:
    """Of two short episodes; none is running yet."""
    services = Services(tmp_path, episodes=2)
    yield services
    services.kill()


def test_services_walk_and_record(services: Services, root_world: Any, tmp_path: Path) -> None:
    """The simulator is killed in the first episode and started again, as its restart policy would."""
    heard, torques = root_world.hear("episode"), root_world.hear("torque")
    services.start()
    root_world.wait(lambda: len(torques) > 20, PATIENCE)
    services.kill("simulator")
    services.start("simulator")
    root_world.wait(lambda: any(e.episode == 2 and e.phase == Episode.ENDED for e in heard), PATIENCE)
    assert services.end() == dict.fromkeys(("simulator", "controller", "trainer", "recorder", "viewer"), 0)
    (recording,) = tmp_path.glob("recording-*")
    broken, whole = iterate_episodes(recording)
    assert (broken.number, broken.outcome) == (1, "reset")
    assert (whole.number, whole.outcome) == (2, "walked")
    assert whole.last - whole.first + 1 == whole.recorded + whole.lost
    assert list((tmp_path / "training").iterdir())
