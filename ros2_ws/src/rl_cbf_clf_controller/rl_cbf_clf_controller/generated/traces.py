"""Traces of a tick as machine code, with the same digits: CasADi's virtual machine takes three times as long.

`make build` compiles those of the usual controllers (`compile_traces.py`). A trace's name has a hash of all that it
computes. So one that is not there, of other parameters or changed code, is evaluated by CasADi as before.
"""

import hashlib
import os
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cbf_clf_qp.symbols import ca

from rl_cbf_clf_controller.generated.library import FLAGS, find_built, load_library


def trace_name(function: Any) -> str:
    """Of the library that has this trace."""
    return f"trace-{hashlib.sha256(function.serialize().encode()).hexdigest()[:16]}.so"


def compiled_trace(function: Any) -> Any:
    """The compiled one; `function` itself where there is none that fits this machine."""
    path = find_built(trace_name(function))
    try:
        return ca.external(function.name(), str(path)) if path else function
    except RuntimeError:
        return function


def compile_trace(function: Any, folder: Path) -> Path:
    """Compile it into `folder`.

    Raises:
        OSError: there is no compiler.
        subprocess.CalledProcessError: it failed.
    """
    path, terms = folder / trace_name(function), load_library()
    if path.is_file():
        return path
    called = [terms._name, f"-Wl,-rpath,{Path(terms._name).parent}"] if terms else []
    with TemporaryDirectory(dir=folder) as work:
        generator = ca.CodeGenerator("trace.c", {"with_header": False})
        generator.add(function)
        generator.generate(work + os.sep)
        made = Path(work) / path.name
        compiler = os.environ.get("CC", "cc")
        subprocess.run([compiler, *FLAGS, f"{work}/trace.c", *called, "-o", str(made), "-lm"], check=True)
        made.replace(path)
    return path
