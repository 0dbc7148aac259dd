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
from rabbit_bringup.recording.reader import iterate_episodes
from rabbit_msgs.msg import Episode

ROOT = Path(__file__).resolve().parents[2]
CHANGED = {"/opt/rabbit": str(ROOT), "port 8765": "port 0", "0.0.0.0": "127.0.0.1", "pace:=1.0": "pace:=0.0"}
SHORT = " -p stones:=3 -p episodes:=1"
PATIENCE = 180.0  # s


@pytest.fixture
def services(tmp_path: Path) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """The running nodes, by service."""
    text = re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", (ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8"))
    for word, other in CHANGED.items():
        assert word in text
        text = text.replace(word, other)
    commands = {name: service["command"] for name, service in yaml.safe_load(text)["services"].items()}
    commands["simulator"] += SHORT
    del commands["ground"]
    running = {
        name: subprocess.Popen(shlex.split(command), cwd=tmp_path, env={**os.environ, "OMP_NUM_THREADS": "1"})
        for name, command in commands.items()
    }
    yield running
    for process in running.values():
        process.kill()
        process.wait()


def test_services_walk_and_record(
    services: dict[str, subprocess.Popen[bytes]], root_world: Any, tmp_path: Path
) -> None:
    heard = root_world.hear("episode")
    root_world.wait(lambda: any(message.phase == Episode.ENDED for message in heard), PATIENCE)
    for process in services.values():
        process.send_signal(signal.SIGTERM)
    end = time.monotonic() + PATIENCE
    assert {name: process.wait(end - time.monotonic()) for name, process in services.items()} == dict.fromkeys(
        services, 0
    )
    (recording,) = tmp_path.glob("recording-*")
    (episode,) = iterate_episodes(recording)
    assert episode.outcome == "walked"  # a recorder started beside the graph may miss its first ticks
    assert episode.last - episode.first + 1 == episode.recorded + episode.lost
    assert list((tmp_path / "training").iterdir())
