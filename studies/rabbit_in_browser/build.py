"""Builds the folder of the page: an `index.html`, and `walk/` with all that it asks for. Any web server can serve it.

    zig compiles the tick that CasADi wrote as C, with DAQP's source, to WebAssembly
    MuJoCo's module is copied as its makers publish it, the page's files as `rabbit play` serves them

What is large is compressed here, and unpacked by the browser, so that no server has to do it.
"""

import gzip
import json
import os
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import casadi as ca
from cbf_clf_qp.functions import one_at_a_time
from rabbit_viewer.page.files import contents
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.robot_numbers import Feet, read_robot
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.virtual_constraints import RABBIT_ANGLES, output_functions
from rl_cbf_clf_controller.weights import policy_path

from rabbit_in_browser.numbers import CONTROLLERS, page_numbers
from rabbit_in_browser.tick_in_c import actor_in_c, places_in_row, tick_in_c

OWN = Path(__file__).parent / "page"
FOLDER = "walk"
LIBC = "wasm32-wasi"  # for exp, sin, malloc; it imports nothing
SECURITY = (  # MuJoCo's bindings make functions from text as they start
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; connect-src 'self'; "
    "script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; img-src 'self' data:\">"
)

LICENSES = """mujoco.js, mujoco.wasm.gz: MuJoCo, Apache-2.0, https://github.com/google-deepmind/mujoco
tick.wasm.gz: this project, Apache-2.0; libc of musl and wasi-libc, MIT; and DAQP, whose licence follows.

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
    with TemporaryDirectory() as made:
        source = Path(made) / "tick.c"
        numbers = write_c(source)
        module = compile_c(source, list(numbers["functions"]), zig, daqp, cache).read_bytes()
    large = {
        "tick.wasm": module,
        "mujoco.wasm": (mujoco / "mujoco.wasm").read_bytes(),
        "numbers.json": json.dumps(numbers).encode(),
        "policy.safetensors": policy_path(RL_CBF_CLF_QP.name).read_bytes(),
    }
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


@one_at_a_time
def write_c(path: Path) -> dict[str, Any]:
    """Write all functions as C; the numbers of the page, and of each function its inputs and outputs."""
    objectives: dict[str, ControllerParameters] = {each.objective: each for each, _ in CONTROLLERS.values()}
    ticks = {objective: tick_in_c(objective, parameters) for objective, parameters in objectives.items()}
    outputs, feet, actor = output_functions(RABBIT_ANGLES)[0], Feet(read_robot()), actor_in_c(RL_CBF_CLF_QP)
    functions = {tick.function: tick.places for tick in ticks.values()}
    functions |= {outputs.function: outputs.places, feet.function.function: feet.function.places}
    functions[actor] = places_in_row({"outputs": actor.mx_out(0)})
    generator = ca.CodeGenerator(path.name, {"casadi_int": "int"})
    for function in functions:
        generator.add(function)
    generator.generate(f"{path.parent}/")
    return {**page_numbers(ticks), "functions": {each.name(): about(each, functions[each]) for each in functions}}


def about(function: ca.Function, places: Mapping[str, Any]) -> dict[str, Any]:
    """What `compiled.js` needs of a function that gives one row."""
    inputs = {function.name_in(i): function.numel_in(i) for i in range(function.n_in())}
    found = {name: [place.start, place.stop] for name, (place, _) in places.items()}
    return {"inputs": inputs, "places": found, "size": function.numel_out()}


def compile_c(source: Path, names: list[str], zig: Path, daqp: Path, cache: Path) -> Path:
    """The C code with DAQP's as one WebAssembly module that exports these functions; raises BuildError."""
    module, include = source.with_suffix(".wasm"), source.parent / "include"
    include.mkdir()
    (include / "daqp").symlink_to((daqp / "include").resolve())
    exports = [f"-Wl,--export={name}{part}" for name in names for part in ("", "_work", "_checkout")]
    exports += ["-Wl,--export=malloc", "-Wl,--export=free"]
    options = ["-target", LIBC, "-mexec-model=reactor", "-O2", "-g0", "-Wl,--strip-all"]
    files = [str(source), *map(str, sorted((daqp / "src").glob("*.c"))), f"-I{include}", f"-I{daqp / 'include'}"]
    command = [str(zig), "cc", *options, *exports, *files, "-o", str(module)]
    caches = {f"ZIG_{kind}_CACHE_DIR": str(cache) for kind in ("GLOBAL", "LOCAL")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **caches})
    if done.returncode:
        raise BuildError(f"zig cannot compile the tick: {done.stderr.strip()}")
    return module


def index(page: str) -> str:
    """The page's HTML with its files in FOLDER and our words in it; its module `source` is ours; raises BuildError."""
    words = (OWN / "words.html").read_text(encoding="utf-8")
    page = re.sub(r'(?<=href=|.src=)"(?!data:)([\w/.]+)"', rf'"{FOLDER}/\1"', page)
    page = page.replace(' "./', f' "./{FOLDER}/')
    changes = {
        '<meta charset="utf-8">': f'<meta charset="utf-8">\n{SECURITY}',
        '<a id="save"': '<a id="save" style="display: none"',  # needs a server that writes the file
        "<main>": f"{words}<main>",
    }
    for old, new in changes.items():
        if page.count(old) != 1:
            raise BuildError(f"the page's index.html has {old} {page.count(old)} times; expected once")
        page = page.replace(old, new)
    return page
