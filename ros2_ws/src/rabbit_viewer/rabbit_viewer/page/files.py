"""The files of the page; and one HTML file with the page and a walk, which opens from disk and asks nobody.

`index.html` names its modules in an import map, so that all of them can be put inside.
"""

import base64
import gzip
import json
import re
from functools import cache
from importlib.resources import files
from pathlib import Path

from rabbit_viewer.page import PageError
from rabbit_viewer.page.broadcast import Broadcast

SOCKET = "/walk"  # path of the websocket
SAVED = "/walk.html"  # the page and its walk in one file
KINDS = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
    "js": "text/javascript; charset=utf-8",
    "txt": "text/plain; charset=utf-8",
}
INDEX, ICON = "index.html", "icon.svg"
STATIC = files("rabbit_viewer.page") / "static"
ALONE = (
    '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
    "script-src 'unsafe-inline' data:; style-src 'unsafe-inline'; img-src data:\">"
)


def find_file(path: str) -> tuple[str, bytes] | None:
    """Kind and content of the page's file at a URL's path; None where there is none."""
    name = path.removeprefix("/") or INDEX
    return contents().get(ICON if name == "favicon.ico" else name)  # which a browser also asks for unasked


@cache
def contents() -> dict[str, tuple[str, bytes]]:
    """Kind and content of all files, by name."""
    paths = [*STATIC.iterdir(), *(STATIC / "uplot").iterdir()]
    named = {(f"uplot/{path.name}" if "uPlot" in path.name else path.name): path for path in paths if path.is_file()}
    return {name: (KINDS[name.rpartition(".")[2]], path.read_bytes()) for name, path in named.items() if "." in name}


def write_page(path: Path, broadcast: Broadcast) -> Path:
    """Write what a browser that comes now would see.

    Raises:
        PageError: the file cannot be written.
    """
    try:
        path.write_text(page_with(broadcast), encoding="utf-8")
    except OSError as error:
        raise PageError(f"--export {path}: {error.strerror}") from error
    return path


def page_with(broadcast: Broadcast) -> str:
    """The whole file's text."""
    words, rows = broadcast.known
    walk = json.dumps({"words": words, "rows": in_base64(gzip.compress(rows, mtime=0))}).replace("<", "\\u003c")
    page = text(INDEX)
    page = page.replace('<meta charset="utf-8">', f'<meta charset="utf-8">\n{ALONE}')
    page = re.sub(r'<link rel="stylesheet" href="(.*?)">', lambda m: f"<style>{text(m[1])}</style>", page)
    page = page.replace(f'href="{ICON}"', f'href="data:{KINDS["svg"]};base64,{in_base64(contents()[ICON][1])}"')
    page = re.sub(r'<script src="(.*?)">', lambda m: f"<script>{text(m[1])}", page)
    page = re.sub(r'"\./(\w+\.js)"', lambda m: f'"data:text/javascript;base64,{in_base64(contents()[m[1]][1])}"', page)
    return page.replace("<body>", f'<body>\n<script type="application/json" id="walk-data">{walk}</script>')


def text(name: str) -> str:
    """The text of a file of the page."""
    return contents()[name][1].decode()


def in_base64(data: bytes) -> str:
    """The data as text."""
    return base64.b64encode(data).decode()
