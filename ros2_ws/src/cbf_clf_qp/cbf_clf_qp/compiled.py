"""C code that is compiled once, kept, and loaded by every later process: for what is computed often.

A library lies in `cbf_clf_qp/` of the user's cache folder, named by a hash of all that it is made of. Several processes
may make the same one: each compiles in a folder of its own, and moves the whole library into place. A process has one
compiler at a time, in the background and with the lowest priority, and ends without waiting for it.

Where nothing can be compiled, one line on stderr says why, and who asked goes on without. The environment:

    CBF_CLF_QP_COMPILE=0    compile nothing, load nothing, say nothing
    CBF_CLF_QP_CACHE        the folder, in place of `$XDG_CACHE_HOME/cbf_clf_qp` or `~/.cache/cbf_clf_qp`
    CC                      the compiler, in place of `cc`
"""

import atexit
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from tempfile import mkdtemp
from threading import Lock
from typing import Any, TypeVar

import casadi as ca

T = TypeVar("T")

COMPILE, CACHE = "CBF_CLF_QP_COMPILE", "CBF_CLF_QP_CACHE"
# bits as CasADi's virtual machine has them: no fused operations, and each function of libm itself; -O2 takes twice
# as long to compile, for 5% of a tick
FLAGS = ("-shared", "-fPIC", "-O1", "-fno-builtin", "-ffp-contract=off", "-w", "-Wl,-z,defs", "-Wl,-Bsymbolic")
KNOWN = {"SXFunction", "MXFunction", "Map", "Switch", "DaqpInterface"}  # what a function may be, and have inside
DIGEST = 32  # bytes that end a library: the hash of those before, since to load half of one would end the process
LONGEST = 600  # s, that somebody waits for a compiler
ABANDONED, UNUSED = 3600, 90 * 24 * 3600  # s, after which a compiler's folder and a library are removed


def is_wanted() -> bool:
    """Whether the environment allows to compile."""
    return os.environ.get(COMPILE) != "0"


def c_of(*functions: ca.Function) -> str | None:
    """Functions as C; None where that would not do all that CasADi's virtual machine does.

    A DAQP inside is one with `error_on_fail` off, and with bounds in order, which C does not check. Several threads may
    call it, with all inputs and the first output. Nobody else may make a function meanwhile, see `functions.building`.
    """
    inside = [inner for function in functions for inner in (function, *function.find_functions())]
    if not {inner.class_name() for inner in inside} <= KNOWN:
        return None
    generator = ca.CodeGenerator("function.c", {"casadi_int": "long long int"})
    for function in functions:
        generator.add(function)
    text: str = generator.dump()
    for name in re.findall(r"struct casadi_daqp_data (\w+)_mem\[", text):  # it goes on where there is no optimum
        text = text.replace(f"{name}_release(mid);\n  if (flag) return 1;\n", f"{name}_release(mid);\n")
    # whether they are given is not asked for each number, which would take a quarter of the compiler's time
    text = re.sub(r"arg\[(\d+)\]\? (arg\[\1\]\[\d+\]) : 0;", r"\2;", text)
    text = re.sub(r"if \(res\[0\]!=0\) (res\[0\]\[\d+\]=)", r"\1", text)
    text = re.sub(r"^static (.* casadi_f\d+_(?:mem|unused))", r"static _Thread_local \1", text, flags=re.MULTILINE)
    return None if "if (flag)" in text or "#error" in text else text


class Library:
    """C code as a shared library; `flags` are further ones. It raises nothing: where there is none, it has `failed`."""

    def __init__(self, text: str, *flags: str) -> None:
        casadi, self._compiler = Path(ca.__file__).parent, os.environ.get("CC") or "cc"
        self._text, self.failed = text, not is_wanted()
        self._flags = *FLAGS, *flags, f"-I{casadi / 'include'}", f"-I{casadi / 'include' / 'daqp'}"
        self._linked = *map(str, casadi.glob("libdaqpstat.a")), "-lm"
        of = text, self._compiler, *self._flags, *self._linked, platform.machine(), ca.CasadiMeta.version()
        self._name = sha256("\0".join(of).encode()).hexdigest()[:40] + ".so"

    def loaded(self, load: Callable[[str], T], wait: bool = False) -> T | None:
        """What `load` makes of its path. None as long as it is not there, which has it compiled, or where it `failed`.

        `wait`: until it is there.
        """
        start = time.monotonic()
        while not self.failed:
            try:
                with _lock:
                    path = self._found()
                if path or not wait:
                    return load(str(path)) if path else None
                if time.monotonic() - start > LONGEST:
                    raise OSError(f"{self._compiler} takes more than {LONGEST} s")
            except (OSError, RuntimeError, ValueError) as error:  # RuntimeError: of CasADi's, or no home is known
                self.fail(error)
            time.sleep(0.01)
        return None

    def fail(self, why: Exception) -> None:
        """Do without; once a process, say why."""
        self.failed = True
        if not _said and sys.stderr:
            text = f"cbf_clf_qp: functions are not compiled, and slower: {' '.join(str(why).split())}"
            with suppress(OSError, ValueError):  # stderr is closed
                print(f"{text} ({COMPILE}=0 leaves out this line)", file=sys.stderr, flush=True)
        _said.append(True)

    def _found(self) -> Path | None:
        """Where it lies. Else it is begun, if no other one is."""
        path = cache() / self._name
        if _running and _running[0].is_done():
            _running.clear()
        if path.exists():
            data = path.read_bytes()
            if sha256(data[:-DIGEST]).digest() == data[-DIGEST:]:
                return path
            path.unlink()
        if not (_running or self.failed):
            self._begin(path)
            _running.append(self)
        return None

    def _begin(self, path: Path) -> None:
        command = shlex.split(self._compiler)
        if not (command and shutil.which(command[0])):
            raise FileNotFoundError(f"there is no compiler {self._compiler}")
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_old(path.parent)
        self._folder = folder = Path(mkdtemp(prefix="compiling-", dir=path.parent))
        options: dict[str, Any] = {
            "cwd": folder,
            "env": {**os.environ, "TMPDIR": str(folder)},
            "stdin": subprocess.DEVNULL,
        }
        try:
            (folder / "code.c").write_text(self._text)
            with (folder / "said").open("wb") as said:
                self._process = subprocess.Popen(
                    [*command, *self._flags, "code.c", "-o", path.name, *self._linked],
                    **options,
                    stdout=said,
                    stderr=said,
                    start_new_session=True,  # which Ctrl-C does not reach
                )
        except OSError:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        with suppress(OSError):
            os.setpriority(os.PRIO_PGRP, self._process.pid, 19)

    def is_done(self) -> bool:
        """Whether the compiler is; then the library is in place, or `failed`."""
        code = self._process.poll()
        if code is None:
            return False
        made = self._folder / self._name
        try:
            if code or not made.exists():
                said = (self._folder / "said").read_text(errors="replace").split("\n")
                raise OSError(f"{self._compiler} returns {code}: {next((s for s in said if 'error' in s), said[0])}")
            digest = sha256(made.read_bytes()).digest()
            with made.open("ab") as library:
                library.write(digest)
            made.replace(self._folder.parent / self._name)
        except (OSError, RuntimeError) as error:
            self.fail(error)
        shutil.rmtree(self._folder, ignore_errors=True)
        return True

    def stop(self) -> None:
        """End the compiler."""
        if not self.is_done():
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            shutil.rmtree(self._folder, ignore_errors=True)


_lock, _running, _said = Lock(), list[Library](), list[bool]()


def cache() -> Path:
    """The folder of the libraries."""
    if chosen := os.environ.get(CACHE):
        return Path(chosen).absolute()
    users = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (users if users.is_absolute() else Path.home() / ".cache") / "cbf_clf_qp"


def remove_old(folder: Path) -> None:
    """Libraries that nobody has used for long, and what ended processes have left."""
    for entry in folder.iterdir():
        with suppress(OSError):
            about, is_folder = entry.stat(), entry.is_dir()
            if time.time() - max(about.st_atime, about.st_mtime) > (ABANDONED if is_folder else UNUSED):
                shutil.rmtree(entry) if is_folder else entry.unlink()


@atexit.register
def stop_compiler() -> None:
    """Stops the compiler as the process ends."""
    for library in _running:
        library.stop()


def forget_compiler() -> None:
    """Forgets the compiler in a forked process: it is the parent's."""
    global _lock
    _lock = Lock()
    _running.clear()


os.register_at_fork(after_in_child=forget_compiler)
