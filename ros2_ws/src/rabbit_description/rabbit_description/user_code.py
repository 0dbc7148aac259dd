"""Errors in code that a person brings, a task's file or a package's plugin, in one line: where it is, and what it says.

cart.py, line 12: ZeroDivisionError: division by zero: `nominal={"mass": 1 / 0},`
"""

import linecache
import re
import sysconfig
from pathlib import Path
from traceback import walk_tb
from typing import Any

from rabbit_description.validation import one_line

_OURS = re.compile(r"(rabbit_\w+|rl_trainer|rl_cbf_clf_controller|cbf_clf_qp)(\..*)?|__main__")
_LIBRARIES = {Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib")}
_PACKAGES = {"site-packages", "dist-packages"}
plugged = set[str]()  # top-level modules of loaded plugins, which may lie among the libraries


def fault_in_user_code(error: BaseException) -> str | None:
    """The innermost line of a user's code that led to the error; None where there is none.

    Code is a user's if it is neither this project's nor a library's.
    """
    places = [(frame.f_globals, frame.f_code.co_filename, line) for frame, line in walk_tb(error.__traceback__)]
    if isinstance(error, SyntaxError) and error.filename:
        places.append(({}, error.filename, error.lineno or 0))
    for names, file, line in reversed(places):
        if _is_users(str(names.get("__name__", "")), file):
            text, source = f"{type(error).__name__}: {error}", linecache.getline(file, line, names).strip()
            if isinstance(error, SyntaxError):
                text = f"{type(error).__name__}: {error.msg}"
            return one_line(f"{_shown(file)}, line {line}: {text}" + (f": `{source}`" if source else ""))
    return None


def _is_users(module: str, file: str) -> bool:
    path = Path(file).resolve()
    if _OURS.fullmatch(module) or not path.is_file():
        return False
    is_library = any(path.is_relative_to(place) for place in _LIBRARIES) or _PACKAGES.intersection(path.parts)
    return module.partition(".")[0] in plugged or not is_library


def _shown(file: str) -> Any:
    path = Path(file)
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
