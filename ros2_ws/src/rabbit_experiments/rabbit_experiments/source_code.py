"""The code behind a class: its module, and all that this module imports, also inside functions.

Python files and the data files of their packages count by their bytes, installed libraries by their version. A module
whose name is put together at run time is not seen, but a package that reads its own `__path__` counts with all that its
folder has.
"""

import ast
import hashlib
import site
import sys
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from importlib.util import find_spec, resolve_name
from pathlib import Path
from pkgutil import iter_modules

PROJECT = ("cbf_clf_qp", "rabbit_", "rl_")  # by its bytes too where it is installed
DISTRIBUTIONS = {"pinocchio": "pin", "yaml": "PyYAML"}  # whose names differ from what is imported
SITES = tuple(Path(each).resolve() for each in (*site.getsitepackages(), site.getusersitepackages()))


class SourceError(ValueError):
    """A class whose code is in no file."""


@cache
def code_of(modules: frozenset[str]) -> dict[str, str]:
    """By package: a hash of the files that these modules need of it, or a library's version.

    Raises:
        SourceError: one of the modules has no file.
    """
    own = {each.partition(".")[0] for each in modules}
    files: dict[str, Path] = {}
    found: dict[str, str] = {}
    todo = list(modules)
    while todo:
        name = todo.pop()
        top = name.partition(".")[0]
        if name in files or top in found or top in sys.stdlib_module_names:
            continue
        path = _file(name)
        if path is None:
            if name in modules:
                raise SourceError(f"module {name}: expected a file with its code, so that its results can be kept")
        elif top not in own and not top.startswith(PROJECT) and any(map(path.resolve().is_relative_to, SITES)):
            found[top] = _version(top)
        else:
            files[name], source, (around, dot, _) = path, path.read_bytes(), name.rpartition(".")
            is_package = path.name == "__init__.py"
            todo += [around] if dot else []
            todo += imports(source, name if is_package else around)
            if is_package and b"__path__" in source:
                todo += [f"{name}.{each.name}" for each in iter_modules([str(path.parent)])]
    return found | {top: _hash(top, files) for top in {name.partition(".")[0] for name in files}}


@cache
def imports(source: bytes, package: str) -> list[str]:
    """Modules that a file of a package imports, and names that may be modules; none of a file that is no Python."""
    found: list[str] = []
    try:
        nodes = list(ast.walk(ast.parse(source)))
    except (SyntaxError, ValueError):
        return found
    for node in nodes:
        if isinstance(node, ast.Import):
            found += [each.name for each in node.names]
        elif isinstance(node, ast.ImportFrom):
            name = "." * node.level + (node.module or "")
            origin = resolve_name(name, package) if node.level else name
            found += [origin, *(f"{origin}.{each.name}" for each in node.names)]
    return found


def _file(module: str) -> Path | None:
    """Of a module; None where there is none, also of what is no module."""
    if found := getattr(sys.modules.get(module), "__file__", None):
        return Path(found)
    top, *rest = module.split(".")
    try:
        spec = find_spec(top)
    except ValueError:  # `__main__` of a prompt
        return None
    for part in rest:  # found without importing what is around it
        folders = spec and spec.submodule_search_locations
        spec = PathFinder.find_spec(part, folders) if folders else None
    return Path(spec.origin) if spec and spec.has_location and spec.origin else None


def _hash(top: str, files: dict[str, Path]) -> str:
    """Of a top-level package's modules among these files, and of all data files in its folders."""
    found = {name: path for name, path in files.items() if name.partition(".")[0] == top}
    for name, path in list(found.items()):
        for each in path.parent.rglob("*") if path.name == "__init__.py" else ():
            if each.suffix not in (".py", ".pyc") and "__pycache__" not in each.parts and each.is_file():
                found[f"{name}/{each.relative_to(path.parent)}"] = each
    return hash_of_text("\n".join(f"{name} {hash_of(path)}" for name, path in sorted(found.items())))


def hash_of_text(text: str) -> str:
    """SHA-256, 16 digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def hash_of(path: Path) -> str:
    """SHA-256, 16 digits, of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def _version(top: str) -> str:
    try:
        return version(DISTRIBUTIONS.get(top, top))
    except PackageNotFoundError:
        return " ".join(map(version, packages_distributions().get(top, ()))) or "unknown"
