"""The code that decides a result: a digest of a package's files, data too.

Those are the project's packages that walk or learn, and the packages of the classes that a job names, whole. What a
package of your own imports from a third one of yours does not count: put it into the same package.
"""

import hashlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path

DECIDING = (
    *("cbf_clf_qp", "rabbit_description", "rabbit_common", "rabbit_sim", "rabbit_estimator"),
    *("rl_cbf_clf_controller", "rl_trainer", "rabbit_experiments"),
)


class CodeError(ValueError):
    """A class whose code is in no file."""


@cache
def code_of(modules: frozenset[str]) -> dict[str, str]:
    """Digests by package: of `DECIDING`, and of those of these modules; raises `CodeError`: one has no file."""
    return {name: _digest(name) for name in sorted({*DECIDING, *(module.partition(".")[0] for module in modules)})}


def _digest(package: str) -> str:
    """The digest of all files in a package's folders, or of a module's only one."""
    try:
        spec = find_spec(package)
    except ValueError:  # `__main__` of a prompt
        spec = None
    folders = list(map(Path, (spec and spec.submodule_search_locations) or ()))
    files = [path for folder in folders for path in folder.rglob("*") if path.is_file()]
    if spec and spec.has_location and spec.origin and not folders:
        files = [Path(spec.origin)]
    if not files:
        raise CodeError(f"module {package}: expected a file with its code, so that its results can be kept")
    root = folders[0] if folders else files[0].parent
    lines = [f"{path.relative_to(root)} {hash_of(path)}" for path in sorted(files) if path.suffix != ".pyc"]
    return hash_of_text("\n".join(lines))


def hash_of_text(text: str) -> str:
    """SHA-256, 16 digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def hash_of(path: Path) -> str:
    """SHA-256, 16 digits, of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]
