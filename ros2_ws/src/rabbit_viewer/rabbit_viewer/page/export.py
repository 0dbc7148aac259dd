"""One HTML file with the page and a walk in it: opens from disk, asks nobody for anything."""

import base64
import json
import re
from pathlib import Path

from rabbit_viewer.page.address import PageError
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.files import INDEX, contents

ALONE = (
    '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
    "script-src 'unsafe-inline' data:; style-src 'unsafe-inline'; img-src data:\">"
)


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
    walk = json.dumps({"words": words, "rows": base64.b64encode(rows).decode()}).replace("<", "\\u003c")
    page = text(INDEX)
    page = page.replace('<meta charset="utf-8">', f'<meta charset="utf-8">\n{ALONE}')
    page = re.sub(r'<link rel="stylesheet" href="(.*?)">', lambda m: f"<style>{text(m[1])}</style>", page)
    page = re.sub(r'<script src="(.*?)">', lambda m: f"<script>{text(m[1])}", page)
    page = re.sub(r'"\./(\w+\.js)"', lambda m: f'"data:text/javascript;base64,{encoded(m[1])}"', page)
    return page.replace("<body>", f'<body>\n<script type="application/json" id="walk-data">{walk}</script>')


def text(name: str) -> str:
    """Of a file of the page."""
    return contents()[name][1].decode()


def encoded(name: str) -> str:
    """A file of the page in base64."""
    return base64.b64encode(contents()[name][1]).decode()
