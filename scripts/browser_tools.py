"""What compiles the page that walks in the visitor's browser, in .setup/browser: zig, DAQP's C source, MuJoCo's module.

Only `make docs` installs it, and only where node and npm are: the project itself needs none of it.
"""

import os
import shutil
import sys

from common import STATE, SetUpError, digest, is_done, logged, mark_done, say
from pip_install import REQUIREMENTS, pip_install

BROWSER = STATE / "browser"
TOOLS = {  # as `build_page` names them: a program; folders, the last of which holds what zig has compiled
    "zig": BROWSER / "python" / "ziglang" / "zig",
    "daqp": BROWSER / "daqp" / "csrc",
    "mujoco": BROWSER / "npm" / "node_modules" / "@mujoco" / "mujoco",
    "cache": BROWSER / "cache",
}
LOCKS = [*REQUIREMENTS.glob("browser.txt"), *REQUIREMENTS.glob("daqp_source.txt"), *REQUIREMENTS.glob("npm/*.json")]


def missing() -> str:
    """Why the tools are not there, or nothing."""
    absent = [name for name in ("node", "npm") if shutil.which(name) is None]
    if absent:
        return f"{' and '.join(absent)} not installed"
    return "" if is_done("browser", key()) else "zig and MuJoCo's module are not installed: `make docs` does it"


def key() -> str:
    """Of what is locked."""
    return digest(LOCKS, sys.version)


def install() -> str:
    """Install them, once for each lock; why not, where node or npm is missing.

    Raises:
        SetUpError: a registry did not answer, or gave another file than the one that is locked.
    """
    why = missing()
    if why.startswith(("node", "npm")):
        return why
    if why:
        say("docs: zig, DAQP's source and MuJoCo's module, for the page that walks in the browser")
        shutil.rmtree(BROWSER, ignore_errors=True)
        pip_install("browser.txt", target=BROWSER / "python")
        fetch_daqp()
        fetch_mujoco()
        mark_done("browser", key())
    return ""


def fetch_daqp() -> None:
    """DAQP's source package, unpacked. pip reads its metadata, for which it needs Cython."""
    options = ["--no-binary", ":all:", "--no-deps", "--no-build-isolation", "--require-hashes", "--no-input"]
    command = [sys.executable, "-m", "pip", "download", *options, "--dest", str(BROWSER)]
    environment = {**os.environ, "PYTHONPATH": str(BROWSER / "python")}
    run([*command, "-r", str(REQUIREMENTS / "daqp_source.txt")], "pip-daqp.log", environment)
    (source,) = BROWSER.glob("daqp-*.tar.gz")
    shutil.unpack_archive(source, BROWSER)
    (BROWSER / source.name.removesuffix(".tar.gz")).rename(BROWSER / "daqp")


def fetch_mujoco() -> None:
    """The npm package, as `package-lock.json` has it; none of its scripts runs."""
    shutil.copytree(REQUIREMENTS / "npm", BROWSER / "npm")
    run(["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--prefix", str(BROWSER / "npm")], "npm.log")


def run(command: list[str], log: str, environment: dict[str, str] | None = None) -> None:
    """Run it; raises SetUpError where it fails."""
    if logged(command, STATE / log, environment):
        name = " ".join(command[:2]) if command[0] == "npm" else "pip download"
        raise SetUpError(f"{name} failed: the registry did not answer or has another file (log: .setup/{log})")
