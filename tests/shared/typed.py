"""The code blocks of a page, run one after the other as a reader types them: ```bash and ```python.

They run in one shell, in a folder that has the repository's `examples`. Words after a command make it shorter: an
option that is given twice has its last value.
"""

import os
import re
import shlex
import subprocess
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(bash|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHELL = """set -eo pipefail
trap 'kill $(jobs -p) 2> /dev/null || true' EXIT
pip() {  # into this folder, and from no network
  command pip "$1" --quiet --no-index --no-build-isolation --no-deps --target site "./${@: -1}"
}
more() {
  case "$*" in
%s
  esac
}
serve() (  # until it serves
  "$@" --no-browser --port 0 > served &
  while kill -0 $! && ! grep -q ^open served; do sleep 0.05; done
  kill $!
  wait $!
)
python() { command python "$@" $(more python "$@"); }
rabbit() {
  case "$1 ${2-}" in
  "play "* | "view "* | "bag show") serve command rabbit "$@" ;;
  "walk "*) command rabbit "$@" $(more rabbit "$@") || [ $? = 1 ] ;; # a fall is a walk's result
  *) command rabbit "$@" $(more rabbit "$@") ;;
  esac
}
"""


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of each."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def type_in(page: str, folder: Path, shorter: Mapping[str, str]) -> str:
    """What the page's blocks print; `shorter`: words by the beginning of a command, the first one counts.

    Raises: AssertionError: a block ends otherwise than well.
    """
    (folder / "examples").mkdir()
    for path in (ROOT / "examples").glob("*.*"):
        (folder / "examples" / path.name).write_bytes(path.read_bytes())
    (folder / "ros2_ws").symlink_to(ROOT / "ros2_ws")
    cases = "\n".join(f"  {shlex.quote(words)}*) echo {more} ;;" for words, more in shorter.items())
    typed = [
        text if language == "bash" else f"python - <<'END_OF_BLOCK'\n{text}END_OF_BLOCK\n"
        for language, text in blocks(ROOT / page)
    ]
    command = ["bash", "-c", "\n".join([SHELL % cases, *typed])]
    path = os.pathsep.join([str(folder / "site"), os.environ.get("PYTHONPATH", "")])  # what is installed there is found
    own = {"cwd": folder, "env": {**os.environ, "PYTHONPATH": path}, "timeout": 900}
    done = subprocess.run(command, **own, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{page}: {done.stdout[-2000:]}{done.stderr[-4000:]}"
    return done.stdout
