"""The house's rules: who may import whom, what is declared, and that every library installs and imports without ROS."""

import ast
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import PathDistribution
from pathlib import Path
from xml.etree import ElementTree

import pytest

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws" / "src"
PACKAGES = ("rabbit_description", "rabbit_ros", "rabbit_sim", "rl_cbf_clf_controller", "rl_trainer", "rabbit_bringup")
NOT_BELOW = {  # package -> modules that it must never import
    "rabbit_description": {"rabbit_ros", "rabbit_sim", "rl_cbf_clf_controller", "rl_trainer", "rabbit_bringup"},
    "rabbit_ros": {"rabbit_sim", "rl_cbf_clf_controller", "rl_trainer", "rabbit_bringup"},
    "rabbit_sim": {"rl_cbf_clf_controller", "rl_trainer", "rabbit_bringup"},
    "rl_cbf_clf_controller": {"rabbit_sim", "pybullet", "torch", "rl_trainer", "rabbit_bringup"},
    "rl_trainer": {"rabbit_sim", "pybullet", "rabbit_bringup", "rl_cbf_clf_controller.oracle"},
}
DISTRIBUTIONS = {"yaml": "pyyaml", "pinocchio": "pin", "PIL": "pillow", "pydantic_core": "pydantic"}
DISTRIBUTIONS |= {"annotated_types": "pydantic", "mpl_toolkits": "matplotlib", "foxglove": "foxglove_sdk"}
IMPORT_ALL = """
import importlib, pkgutil, sys
package, *without = sys.argv[1:]
sys.modules.update(dict.fromkeys(without))  # as if they were not installed
root = importlib.import_module(package)
for module in pkgutil.walk_packages(root.__path__, f"{package}."):
    if not module.name.endswith(("node", "__main__")):
        importlib.import_module(module.name)
print(root.__file__, *sys.modules)
"""

pytestmark = pytest.mark.xdist_group("packages")


def is_node(path: Path) -> bool:
    """Whether a file may import rclpy."""
    return path.name == "node.py" or path.name.endswith("_node.py")


def modules(package: str) -> list[Path]:
    """The package's Python files."""
    return sorted((SOURCES / package / package).rglob("*.py"))


@cache
def imports(path: Path) -> frozenset[str]:
    """All dotted names that a file imports, wherever in it."""
    found: set[str] = set()
    for statement in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(statement, ast.Import):
            found |= {alias.name for alias in statement.names}
        elif isinstance(statement, ast.ImportFrom) and statement.module:
            found |= {statement.module, *(f"{statement.module}.{alias.name}" for alias in statement.names)}
    return frozenset(found)


def imports_any(path: Path, names: set[str]) -> set[str]:
    """Which of `names`, or modules under them, a file imports."""
    return {name for name in imports(path) if any(name == other or name.startswith(f"{other}.") for other in names)}


def ros_dependencies(package: str) -> set[str]:
    """What the package's package.xml declares beside our own pip-installable packages."""
    tree = ElementTree.parse(SOURCES / package / "package.xml")
    return {tag.text or "" for tag in tree.iter() if tag.tag.endswith("depend")} - set(PACKAGES) - {"python3-pytest"}


@pytest.mark.parametrize("package", PACKAGES)
def test_only_nodes_know_ros(package: str) -> None:
    ros = ros_dependencies(package) | {"rclpy", "rabbit_msgs", "rabbit_ros"}
    if package == "rabbit_ros":
        ros.remove("rabbit_ros")
    libraries = [path for path in modules(package) if not is_node(path)]
    offenders = {str(path): found for path in libraries if (found := imports_any(path, ros))}
    assert not offenders


@pytest.mark.parametrize("package", NOT_BELOW)
def test_nobody_imports_what_is_above_or_beside(package: str) -> None:
    offenders = {str(path): found for path in modules(package) if (found := imports_any(path, NOT_BELOW[package]))}
    assert not offenders


def test_the_learner_names_no_oracle() -> None:
    names = {name for path in modules("rl_trainer") for name in imports(path)}
    assert names
    assert not [name for name in names if "oracle" in name.lower()]


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Installs a package with pip, by itself, into an empty folder; once a session."""

    @cache
    def install(package: str) -> Path:
        folder = tmp_path_factory.mktemp(package)
        left_over = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
        source = shutil.copytree(SOURCES / package, folder / "source", ignore=left_over)
        options = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation", "--target", str(folder / "target")]
        subprocess.run([sys.executable, "-m", "pip", "install", *options, str(source)], check=True, timeout=300)
        return folder / "target"

    return install


def requirements(target: Path) -> set[str]:
    """Names of what an installed package requires, extras included."""
    (metadata,) = target.glob("*.dist-info")
    return {re.split(r"[^\w.-]", line)[0].replace("-", "_") for line in PathDistribution(metadata).requires or ()}


def family(package: str, installed: Callable[[str], Path]) -> Iterator[str]:
    """The package and those beside it that it requires."""
    yield package
    yield from sorted(requirements(installed(package)) & set(PACKAGES))


def loaded_modules(package: str, installed: Callable[[str], Path]) -> list[str]:
    """Import a pip-installed library without ROS, in a process of its own; returns its file and all that got loaded."""
    path = os.pathsep.join(str(installed(each)) for each in family(package, installed))
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "LD_LIBRARY_PATH") if name in os.environ}
    environment = {**kept, "PYTHONPATH": path, "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", IMPORT_ALL, package, "rclpy", "rabbit_msgs", *ros_dependencies(package)]
    run = subprocess.run(command, env=environment, cwd=path.split(":")[0], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    return run.stdout.strip().splitlines()[-1].split()


@pytest.mark.parametrize("package", PACKAGES)
def test_installs_with_pip_and_imports_without_ros(package: str, installed: Callable[[str], Path]) -> None:
    file, *loaded = loaded_modules(package, installed)
    assert Path(file).is_relative_to(installed(package))
    assert not set(loaded) & NOT_BELOW.get(package, set())


@pytest.mark.parametrize("package", PACKAGES)
def test_data_is_installed(package: str, installed: Callable[[str], Path]) -> None:
    root = SOURCES / package / package
    data = {".yaml", ".urdf", ".safetensors", ".json", ".csv", ".typed"}
    shipped = [path.relative_to(root) for path in root.rglob("*") if path.suffix in data]
    assert not [str(path) for path in shipped if not (installed(package) / package / path).is_file()]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_import_is_declared(package: str, installed: Callable[[str], Path]) -> None:
    declared = requirements(installed(package)) | ros_dependencies(package) | {package, *sys.stdlib_module_names}
    for path in modules(package):
        names = {name.split(".")[0] for name in imports(path)}
        wanted = {DISTRIBUTIONS.get(name, name) for name in names}
        own = declared | ({"rabbit_ros"} if is_node(path) else set())
        assert wanted <= own, f"{path}: {wanted - own} not in setup.py's install_requires or package.xml"
