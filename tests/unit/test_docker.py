"""Images and services: no root, nothing that is not there, nothing open to other machines."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import yaml
from rabbit_bringup.launching.processes import PATIENCE

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docker"


def services() -> dict[str, dict[str, Any]]:
    """Of the compose file, with the defaults of its variables."""
    text = re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", (FOLDER / "compose.yaml").read_text(encoding="utf-8"))
    assert "${" not in text
    return dict(yaml.safe_load(text)["services"])


def test_services_are_reached_from_this_machine_alone_and_have_no_privileges() -> None:
    for name, service in services().items():
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert not {"privileged", "user", "cap_add", "devices"} & set(service)
        assert all(port.startswith("127.0.0.1:") for port in service.get("ports", []))
        if name != "ground":
            assert (service["network_mode"], service["ipc"]) == ("service:ground", "service:ground")


def test_a_container_is_shut_off_and_has_the_time_to_end(tmp_path: Path) -> None:
    command = [str(FOLDER / "run.sh"), "rabbit", "walk"]
    asked = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "ENGINE": "echo", "IMAGE": "image"}, capture_output=True, text=True
    ).stdout.strip()
    assert asked.startswith("run ")
    assert asked.endswith(" image rabbit walk")
    for option in ("--network none", "--cap-drop ALL", "--security-opt no-new-privileges", "--init", "--rm"):
        assert f" {option} " in asked
    assert f" --volume {tmp_path}/runs:/walks/runs " in asked
    (stop_timeout,) = re.findall(r"--stop-timeout (\d+)", asked)
    assert int(stop_timeout) > PATIENCE
