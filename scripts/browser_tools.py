"""What compiles the page that walks in the visitor's browser, in .setup/browser: zig, DAQP's C source, MuJoCo's module.

Only `make docs` installs it, and only where node and npm are: the project itself needs none of it.
"""

import shutil
import sys

from common import ROOT, STATE, SetUpError, digest, is_done, logged, mark_done, say
from pip_install import REQUIREMENTS, pip_install

BROWSER = STATE / "browser"
TOOLS = {  # as `build_page` names them: a program; folders, the last of which holds what zig has compiled
    "zig": BROWSER / "python" / "ziglang" / "zig",
    "daqp": BROWSER / "daqp" / "csrc",
    "mujoco": BROWSER / "npm" / "node_modules" / "@mujoco" / "mujoco",
    "cache": BROWSER / "cache",
}
DAQP = ROOT / "ros2_ws" / "src" / "cbf_clf_qp" / "cbf_clf_qp" / "daqp_source.txt"
LOCKS = [*REQUIREMENTS.glob("browser.txt"), DAQP, *REQUIREMENTS.glob("npm/*.json")]


def missing() -> str:
    """Why the tools are not there, or nothing."""
    absent = [name for name in ("node", "npm") if shutil.which(name) is None]
    if absent:
        return f"{' and '.join(absent)} not installed"
    return "" if is_done("browser", key()) else "zig and MuJoCo's module are not installed: `make docs` does it"


def key() -> str:
    """A key of what is locked."""
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
    """DAQP's source package, unpacked."""
    from cbf_clf_qp.daqp_source import SourceError, unpack_daqp

    try:
        unpack_daqp(BROWSER).parent.rename(BROWSER / "daqp")
    except SourceError as error:
        raise SetUpError(str(error)) from error


def fetch_mujoco() -> None:
    """The npm package, as `package-lock.json` has it; none of its scripts runs."""
    shutil.copytree(REQUIREMENTS / "npm", BROWSER / "npm")
    command = ["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--prefix", str(BROWSER / "npm")]
    if logged(command, STATE / "npm.log"):
        raise SetUpError("npm ci failed: the registry did not answer or has another file (log: .setup/npm.log)")
