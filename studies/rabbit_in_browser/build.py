"""Builds the folder of the page: an `index.html`, and `walk/` with all that it asks for. Any web server can serve it.

    zig compiles each controller, as `rabbit export` writes it, to WebAssembly
    MuJoCo's module is copied as its makers publish it, the page's files as `rabbit play` serves them

What is large is compressed here, and unpacked by the browser, so that no server has to do it.
"""

import gzip
import json
import os
import re
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from rabbit_viewer.page.files import contents
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.export import export, tables_of
from rl_cbf_clf_controller.policy import ActorPolicy

from rabbit_in_browser.numbers import controllers, page_numbers

OWN = Path(__file__).parent / "page"
FOLDER = "walk"
LIBC = "wasm32-wasi"  # for exp, sin, malloc; it imports nothing
SECURITY = (  # MuJoCo's bindings make functions from text as they start
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; connect-src 'self'; "
    "script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; img-src 'self' data:\">"
)

LICENSES = """mujoco.js, mujoco.wasm.gz: MuJoCo, Apache-2.0, https://github.com/google-deepmind/mujoco
the other .wasm.gz: this project, Apache-2.0; libc of musl and wasi-libc, MIT; and DAQP, whose licence follows.

"""


class BuildError(Exception):
    """What could not be built, and why."""


def build_page(site: Path, zig: Path, daqp: Path, mujoco: Path, cache: Path) -> None:
    """Write `site`/index.html and the folder beside it.

    Args:
        zig: the program.
        daqp: folder of DAQP's C source, with `include` and `src`.
        mujoco: folder of the npm package @mujoco/mujoco.
        cache: folder in which zig keeps what it has compiled.

    Raises:
        BuildError: the C code cannot be compiled, or the page has no place for what is added.
    """
    folder = site / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    made, large = controllers(), {"mujoco.wasm": (mujoco / "mujoco.wasm").read_bytes()}
    large["numbers.json"] = json.dumps(numbers := page_numbers(made)).encode()
    for name, controller in made.items():
        large[numbers["controllers"][name]["module"]] = compiled(controller, zig, daqp, cache)
    for name, data in large.items():
        (folder / f"{name}.gz").write_bytes(gzip.compress(data, mtime=0))
    for name, (_, data) in contents().items():
        if name != "index.html":
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(data)
    (folder / "LICENSES.txt").write_text(LICENSES + (daqp.parent / "LICENSE").read_text(), encoding="utf-8")
    for path in OWN.glob("*.js"):
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "mujoco.js").write_bytes((mujoco / "mujoco.js").read_bytes())
    (site / "index.html").write_text(index(contents()["index.html"][1].decode()), encoding="utf-8")


def compiled(controller: Controller, zig: Path, daqp: Path, cache: Path) -> bytes:
    """The exported controller as one WebAssembly module; raises BuildError."""
    with TemporaryDirectory() as made:
        folder = Path(made)
        export(controller, folder, daqp)
        exports = ["controller_first", "controller_settings", "controller_step", "malloc", "free"]
        if isinstance(controller.policy, ActorPolicy):
            exports += ["policy_forward", *tables_of(controller.policy)]
        options = ["-target", LIBC, "-mexec-model=reactor", "-O2", "-fno-builtin", "-ffp-contract=off", "-w", "-g0"]
        options += ["-Wl,--strip-all", *(f"-Wl,--export={name}" for name in exports)]
        include = folder / "daqp" / "include"
        sources = map(str, sorted((folder / "daqp" / "src").glob("*.c")))
        caches = {f"ZIG_{kind}_CACHE_DIR": str(cache) for kind in ("GLOBAL", "LOCAL")}
        command = [str(zig), "cc", *options, f"-I{include}", f"-I{include / 'daqp'}", "-Dmalloc=controller_malloc"]
        command += ["-Dfree=controller_free", str(folder / "controller.c"), *sources, "-o", "controller.wasm"]
        environment = {**os.environ, **caches}
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment)
        if done.returncode:
            raise BuildError(f"zig cannot compile the controller: {done.stderr.strip()}")
        return (folder / "controller.wasm").read_bytes()


def index(page: str) -> str:
    """The page's HTML with its files in FOLDER and our words in it; its module `source` is ours; raises BuildError."""
    words = (OWN / "words.html").read_text(encoding="utf-8")
    page = re.sub(r'(?<=href=|.src=)"(?!data:)([\w/.]+)"', rf'"{FOLDER}/\1"', page)
    page = page.replace(' "./', f' "./{FOLDER}/')
    changes = {
        '<meta charset="utf-8">': f'<meta charset="utf-8">\n{SECURITY}',
        f'<a id="save" href="{FOLDER}/walk.html"': '<a id="save" style="display: none"',  # needs a server
        "<main>": f"{words}<main>",
    }
    for old, new in changes.items():
        if page.count(old) != 1:
            raise BuildError(f"the page's index.html has {old} {page.count(old)} times; expected once")
        page = page.replace(old, new)
    return page
