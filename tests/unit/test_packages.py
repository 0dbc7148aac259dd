"""The house's rules: who may import whom, what is declared, and that every library installs and imports without ROS."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from importlib.metadata import PathDistribution
from pathlib import Path
from xml.etree import ElementTree

import pytest
from catkin_pkg.package import parse_package

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws" / "src"
PACKAGES = (  # each may import only packages before it, and not those beside it
    *("cbf_clf_qp", "rabbit_description", "rabbit_ros", "rabbit_cli"),
    *("rabbit_sim", "rl_cbf_clf_controller", "rl_trainer", "rabbit_gait_design"),
    *("rabbit_recording", "rabbit_viewer", "rabbit_experiments", "rabbit_bringup", "rabbit_campaigns"),
)
BESIDE = {  # package -> modules before it, or libraries, that it must never import
    "cbf_clf_qp": {"pinocchio", "torch", "pybullet", "pydantic"},
    "rl_cbf_clf_controller": {"rabbit_sim", "pybullet", "torch"},
    "rl_trainer": {"rabbit_sim", "pybullet", "rl_cbf_clf_controller.oracle"},
    "rabbit_gait_design": {"rabbit_sim", "rl_trainer"},
}
NOT_BELOW = {  # package -> modules that it must never import
    package: {*PACKAGES[i + 1 :], *BESIDE.get(package, ())} for i, package in enumerate(PACKAGES)
}
BROUGHT_BY = {"pydantic_core": "pydantic", "annotated_types": "pydantic", "mpl_toolkits": "matplotlib"}
BROUGHT_BY |= {"foxglove": "foxglove_sdk", "torch.utils.tensorboard": "tensorboard"}
DISTRIBUTIONS = {"yaml": "pyyaml", "pinocchio": "pin"}  # what pip calls them
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


def is_node(path: Path) -> bool:
    """Whether a file may import rclpy."""
    return path.parent.name == "ros"


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


def imported(paths: Iterable[Path]) -> set[str]:
    """The libraries and packages that files import, without the standard library."""
    names = {name for path in paths for name in imports(path)}
    wanted = {BROUGHT_BY.get(name.split(".")[0], name.split(".")[0]) for name in names}
    return (wanted | {BROUGHT_BY[name] for name in names & set(BROUGHT_BY)}) - set(sys.stdlib_module_names)


def rosdep_keys(package: str) -> set[str]:
    """What the package's package.xml declares to be needed at run time."""
    return {tag.text or "" for tag in ElementTree.parse(SOURCES / package / "package.xml").iter("exec_depend")}


def ros_dependencies(package: str) -> set[str]:
    """The packages of ROS among them."""
    libraries = {key for key in rosdep_keys(package) if key.startswith("python3-") or key.endswith("-pip")}
    return rosdep_keys(package) - set(PACKAGES) - libraries - {"pinocchio"}  # ROS packages this library too


def without_key(package: str) -> set[str]:
    """The libraries that package.xml names in its comment, since rosdep has no key for them."""
    (named,) = re.findall(r"<!-- without a rosdep key: (.+) -->", (SOURCES / package / "package.xml").read_text()) or [
        ""
    ]
    return {name.replace("-", "_") for name in named.split(", ") if name}


@pytest.mark.parametrize("package", PACKAGES)
def test_only_nodes_know_ros(package: str) -> None:
    ros = ros_dependencies(package) | {"rclpy", "rabbit_msgs", "rabbit_ros"}
    if package == "rabbit_ros":
        ros.remove("rabbit_ros")
    libraries = [path for path in modules(package) if not is_node(path)]
    offenders = {str(path): found for path in libraries if (found := imports_any(path, ros))}
    assert not offenders


@pytest.mark.parametrize("package", PACKAGES)
def test_nobody_imports_what_is_above_or_beside(package: str) -> None:
    offenders = {str(path): found for path in modules(package) if (found := imports_any(path, NOT_BELOW[package]))}
    assert not offenders


def test_the_page_on_the_architecture_lists_them_in_this_order() -> None:
    page = (SOURCES.parents[1] / "docs" / "architecture.md").read_text(encoding="utf-8")
    listed = [line.split()[0] for line in page.split("```")[1].strip().splitlines()]
    assert [name for name in listed if name != "rabbit_msgs"] == list(PACKAGES)


def name_of(path: Path) -> str:
    """A module's dotted name."""
    return ".".join(path.relative_to(SOURCES).with_suffix("").parts[1:]).removesuffix(".__init__")


def imported_at_once(statement: ast.AST) -> Iterator[str]:
    """What a module imports when it is imported itself: not in its functions, not for the type checker."""
    for child in ast.iter_child_nodes(statement):
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom) and child.module:
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
        elif not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef) and "TYPE_CHECKING" not in ast.unparse(
            getattr(child, "test", ast.Constant(0))
        ):
            yield from imported_at_once(child)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_imports_itself_by_way_of_others(package: str) -> None:
    names = {name_of(path): path for path in modules(package)}
    graph = {}
    for name, path in names.items():
        found = set(imported_at_once(ast.parse(path.read_text(encoding="utf-8"))))
        graph[name] = {each if each in names else each.rpartition(".")[0] for each in found} & names.keys() - {name}
    list(TopologicalSorter(graph).static_order())  # raises CycleError with the circle


def test_the_learner_names_no_oracle() -> None:
    names = {name for path in modules("rl_trainer") for name in imports(path)}
    assert names
    assert not [name for name in names if "oracle" in name.lower()]


@pytest.fixture(scope="session")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages' sources in an empty folder, without what pip leaves in them."""
    left_over = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    return shutil.copytree(SOURCES, tmp_path_factory.mktemp("checkout") / "src", ignore=left_over)


@pytest.fixture(scope="session")
def installed(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Installs a package with pip, by itself, into an empty folder; once a session."""

    @cache
    def install(package: str) -> Path:
        target = tmp_path_factory.mktemp(package)
        options = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation", "--target", str(target)]
        command = [sys.executable, "-m", "pip", "install", *options, str(checkout / package)]
        subprocess.run(command, check=True, timeout=300)
        return target

    return install


@pytest.mark.parametrize("package", PACKAGES)
def test_package_xml_declares_what_is_imported_and_nothing_else(package: str) -> None:
    wanted = imported([*modules(package), *SOURCES.glob(f"{package}/launch/*.py")]) - {package}
    needed_by_command = {"ros2launch"} & rosdep_keys(package)  # `ros2 launch` itself
    keys = {re.sub(r"^python3-|-pip$", "", key) for key in rosdep_keys(package)}
    assert keys | without_key(package) == wanted | needed_by_command


def test_one_maintainer_whom_ros_tools_accept() -> None:
    files = [*SOURCES.glob("*/package.xml"), *SOURCES.parent.glob("stand_ins/*/package.xml")]
    found = {str(person) for file in files for person in parse_package(file).maintainers}
    assert len(files) == len(PACKAGES) + 2  # rabbit_msgs and the stand-in
    assert len(found) == 1
    assert "example" not in found.pop()


def test_pip_finds_the_packages_beside(checkout: Path, tmp_path: Path) -> None:
    options = ["--dry-run", "--no-index", "--no-build-isolation", "--report", str(tmp_path / "report.json")]
    command = [sys.executable, "-m", "pip", "install", "--quiet", *options, str(checkout / PACKAGES[-1])]
    subprocess.run(command, check=True, timeout=300)
    items = json.loads((tmp_path / "report.json").read_text())["install"]
    found = {item["metadata"]["name"].replace("-", "_"): item["download_info"]["url"] for item in items}
    wanted = set(PACKAGES) - {"rabbit_ros"}  # of use to nodes alone, which need ROS
    assert wanted <= set(found)
    assert not [url for name, url in found.items() if name in wanted and not url.endswith(f"{checkout}/{name}")]


def requirements(target: Path) -> set[str]:
    """Names of what an installed package requires, extras included."""
    (metadata,) = target.glob("*.dist-info")
    return {re.split(r"[^\w.-]", line)[0].replace("-", "_") for line in PathDistribution(metadata).requires or ()}


def family(package: str, installed: Callable[[str], Path]) -> set[str]:
    """The package and those beside it that it requires, or that these require."""
    needed = requirements(installed(package)) & set(PACKAGES)
    return {package}.union(*(family(each, installed) for each in needed))


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
def test_setup_py_requires_what_is_imported_and_nothing_else(package: str, installed: Callable[[str], Path]) -> None:
    required = requirements(installed(package)) - {"pytest"}
    wanted = {DISTRIBUTIONS.get(name, name) for name in imported(modules(package))} - {package, "rabbit_ros"}
    assert required - {"rabbit_ros"} == wanted - {"rabbit_msgs", *ros_dependencies(package)}
