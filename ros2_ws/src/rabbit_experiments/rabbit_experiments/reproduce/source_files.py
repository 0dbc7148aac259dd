"""Which of our own source files a module runs, found by following its imports; their hash.

A figure's file may change without any run being made again; the controller's may not.
"""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

OURS = (
    "cbf_clf_qp",
    "rabbit_description",
    "rabbit_sim",
    "rl_cbf_clf_controller",
    "rl_trainer",
    "rabbit_viewer",
    "rabbit_experiments",
)
DATA = ("rabbit_description", "*.urdf")  # what is read beside the source, and is no parameter of a run


def reached_from(*modules: str) -> dict[str, Path]:
    """The files of `modules` and of all of our modules that they import, directly or not, by module name."""
    found: dict[str, Path] = {}
    left = list(modules)
    while left:
        name = left.pop()
        if name not in found and (path := _file(name)):
            found[name] = path
            left += _imports(path)
            left += [name.rpartition(".")[0]] if "." in name else []
    return found


@cache
def sources_hash(*modules: str) -> str:
    """SHA-256, 16 digits, of the content of `reached_from(*modules)` and of the robot's description."""
    files = reached_from(*modules)
    package, pattern = DATA
    root = files[package].parent if package in files else None
    for path in sorted(root.rglob(pattern)) if root else ():
        files[path.name] = path
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(name.encode() + b"\0" + files[name].read_bytes())
    return digest.hexdigest()[:16]


def _imports(path: Path) -> Iterator[str]:
    """Modules of ours that a file names; of `from a import b` both a and a.b, whichever is one."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        yield from (name for name in names if name.split(".")[0] in OURS)


@cache
def _file(module: str) -> Path | None:
    """Where a module is; None where the name is not one's."""
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        return None  # a class or function of a module
    return Path(spec.origin) if spec and spec.origin else None
