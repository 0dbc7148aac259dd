"""The files of the page. `index.html` names its modules in an import map, so that `export` can put them inside."""

from functools import cache
from importlib.resources import files

SOCKET = "/walk"  # path of the websocket
SAVED = "/walk.html"  # the page and its walk in one file
KINDS = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "txt": "text/plain; charset=utf-8",
}
INDEX = "index.html"
STATIC = files("rabbit_viewer.page") / "static"


def find_file(path: str) -> tuple[str, bytes] | None:
    """Kind and content of the page's file at a URL's path; None where there is none."""
    name = path.removeprefix("/") or INDEX
    return contents().get(name)


@cache
def contents() -> dict[str, tuple[str, bytes]]:
    """Kind and content of all files, by name."""
    found = [*STATIC.iterdir(), *(STATIC / "uplot").iterdir()]
    named = {(f"uplot/{file.name}" if "uPlot" in file.name else file.name): file for file in found if file.is_file()}
    return {name: (KINDS[name.rpartition(".")[2]], file.read_bytes()) for name, file in named.items() if "." in name}
