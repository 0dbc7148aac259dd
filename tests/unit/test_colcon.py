"""Plain colcon builds, walks and tests a copy; each package installs and imports without ROS."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from functools import cache
from importlib.metadata import PathDistribution
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "ros2_ws" / "src"


def copy_to(folder: Path) -> Path:
    """The packages' sources where nothing else of the project is, without what pip leaves in them."""
    left_over = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    return shutil.copytree(SOURCES, folder / "src", ignore=left_over)


@pytest.fixture(scope="module")
def walking(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The workspace of a copy, built."""
    workspace = copy_to(tmp_path_factory.mktemp("copied")).parent
    done = in_shell(f"python {shutil.which('colcon')} build", workspace)
    assert done.returncode == 0, done.stderr
    return workspace


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
    tested = f"{colcon} test --packages-select cbf_clf_qp --pytest-args ' -k test_estimates'"
    tested += f"; {colcon} test-result --all"
    said = in_shell(f"source install/setup.bash; {tested}", walking).stdout
    assert re.search(r"Summary: [1-9]\d* tests, 0 errors, 0 failures", said), said


LINTER = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
PACKAGES = [name for name in LINTER["root_packages"] if (SOURCES / name).is_dir()]
# modules that a package must not load even through others; rclpy is hidden below anyway
NEVER_LOADED = {
    contract["source_modules"][0]: {*contract["forbidden_modules"]} - {"rclpy"}
    for contract in LINTER["contracts"]
    if len(contract.get("source_modules", ())) == 1
}
IMPORT_ALL = """
import importlib, pkgutil, sys
package, *without = sys.argv[1:]
sys.modules.update(dict.fromkeys(without))  # as if they were not installed
root = importlib.import_module(package)
for module in pkgutil.walk_packages(root.__path__, f"{package}."):
    if ".ros." not in module.name and not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print(root.__file__, *sys.modules)
"""


def ros_dependencies(package: str) -> set[str]:
    """The packages of ROS that its package.xml declares to be needed at run time."""
    keys = {tag.text or "" for tag in ElementTree.parse(SOURCES / package / "package.xml").iter("exec_depend")}
    libraries = {key for key in keys if key.startswith("python3-") or key.endswith("-pip")}
    return keys - set(PACKAGES) - libraries - {"pinocchio"}  # ROS packages this library too


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Installs a package with pip, by itself, into an empty folder; once a session."""
    checkout = copy_to(tmp_path_factory.mktemp("checkout"))

    @cache
    def install(package: str) -> Path:
        target = tmp_path_factory.mktemp(package)
        options = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation", "--target", str(target)]
        command = [sys.executable, "-m", "pip", "install", *options, str(checkout / package)]
        subprocess.run(command, check=True, timeout=300)
        return target

    return install


def required(target: Path) -> dict[str, str]:
    """What an installed package requires, extras included: lines by name."""
    (metadata,) = target.glob("*.dist-info")
    lines = PathDistribution(metadata).requires or ()
    return {re.split(r"[^\w.-]", line)[0].replace("-", "_"): line for line in lines}


def family(package: str, installed: Callable[[str], Path]) -> set[str]:
    """The package and those beside it that it requires, or that these require."""
    needed = required(installed(package)).keys() & set(PACKAGES)
    return {package}.union(*(family(dependency, installed) for dependency in needed))


def loaded_modules(package: str, installed: Callable[[str], Path]) -> list[str]:
    """Import a pip-installed library without ROS, in a process of its own; returns its file and all that got loaded."""
    path = os.pathsep.join(str(installed(member)) for member in family(package, installed))
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LD_LIBRARY_PATH") if name in os.environ}
    environment = {**kept, "PYTHONPATH": path, "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", IMPORT_ALL, package, "rclpy", "rabbit_msgs", *ros_dependencies(package)]
    run = subprocess.run(command, env=environment, cwd=path.split(":")[0], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    return run.stdout.strip().splitlines()[-1].split()


@pytest.mark.parametrize("package", PACKAGES)
def test_installs_with_pip_and_imports_without_ros(package: str, installed: Callable[[str], Path]) -> None:
    """With its data; it requires the others in its own version, and no folder."""
    file, *loaded = loaded_modules(package, installed)
    assert Path(file).is_relative_to(installed(package))
    assert not set(loaded) & NEVER_LOADED.get(package, set())
    (metadata,) = installed(package).glob("*.dist-info")
    lines, version = required(installed(package)), PathDistribution(metadata).version
    assert not [line for line in lines.values() if "@" in line]
    assert all(lines[name] == f"{name}=={version}" for name in lines.keys() & set(PACKAGES))
    root, kinds = SOURCES / package / package, {".yaml", ".urdf", ".safetensors", ".json", ".csv", ".xml", ".typed"}
    data = [path.relative_to(root) for path in root.rglob("*") if path.suffix in kinds]
    assert not [str(path) for path in data if not (installed(package) / package / path).is_file()]
