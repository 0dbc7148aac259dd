"""Plain colcon: a copy of the sources is built, walks and is tested."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKSPACE = ROOT / "ros2_ws"


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages' sources where nothing else of the project is."""
    left_over = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    return shutil.copytree(WORKSPACE / "src", tmp_path_factory.mktemp("copied") / "src", ignore=left_over)


@pytest.fixture(scope="module")
def walking(copied: Path) -> Path:
    """The workspace of that copy, built."""
    done = in_shell(f"python {shutil.which('colcon')} build", copied.parent)
    assert done.returncode == 0, done.stderr
    return copied.parent


def in_shell(script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run it there, over the environment alone."""
    kept = {name: os.environ[name] for name in ("PATH", "HOME")} | {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}
    kept["MAKEFLAGS"] = f"-j{os.cpu_count()}"  # colcon's own waits for idle cores
    command = ["bash", "-c", f"source {ROOT}/.venv/setup.bash; {script}"]
    return subprocess.run(command, cwd=folder, env=kept, capture_output=True, text=True, timeout=1800)


@pytest.mark.timeout(1800)
def test_a_copy_of_the_sources_walks_with_all_nodes(walking: Path) -> None:
    options = "--controller cbf-clf-qp --sensors lab --stones 1 --view --view-port 0 --no-pictures --no-video"
    done = in_shell(f"source install/setup.bash; rabbit walk {options} --ready-timeout 600 --out walk", walking)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "walked: 1 of 1" in done.stdout
    assert len(list(walking.glob("walk/log/*.log"))) == 6


@pytest.mark.timeout(900)
def test_colcon_test_runs_a_packages_tests(walking: Path) -> None:
    colcon = f"python {shutil.which('colcon')}"
    tested = (
        f"{colcon} test --packages-select cbf_clf_qp --pytest-args ' -k test_estimates'; {colcon} test-result --all"
    )
    said = in_shell(f"source install/setup.bash; {tested}", walking).stdout
    assert re.search(r"Summary: [1-9]\d* tests, 0 errors, 0 failures", said), said
