"""`make docs`: the site in docs/build. Its pages open from disk, without a network.

Its first page, where the robot walks, needs any web server, and node and npm as it is built.
Sphinx and what it needs lie in .setup/sphinx, apart from .venv: the ROS wheels pin a docutils that is too new for it.
"""

import os
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import browser_tools
from common import ROOT, STATE, SetUpError, digest, is_done, main, mark_done, say
from pip_install import REQUIREMENTS, pip_install

SPHINX = STATE / "sphinx"
SITE = ROOT / "docs" / "build"


class Requests(HTMLParser):
    """The addresses on other hosts that a page asks for as it opens."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Links that a reader follows (`a`) are not asked for."""
        for name, value in attrs:
            if tag != "a" and name in ("src", "href", "srcset", "data") and (value or "").startswith(("http", "//")):
                self.found.append(f"{tag} {value}")


def outside_requests(site: Path) -> list[str]:
    """What the pages of a folder ask of other hosts, as `page: tag address`."""
    found = []
    for path in sorted(site.rglob("*.html")):
        page = Requests()
        page.feed(path.read_text(encoding="utf-8"))
        found += [f"{path.relative_to(site)}: {request}" for request in page.found]
    return found


def install_sphinx() -> None:
    """Install Sphinx in its folder, once for each lock."""
    key = digest([REQUIREMENTS / "docs.txt"], sys.version)
    if not (SPHINX.is_dir() and is_done("docs", key)):
        say("docs: Sphinx")
        shutil.rmtree(SPHINX, ignore_errors=True)
        pip_install("docs.txt", target=SPHINX)
        mark_done("docs", key)


def build_first_page() -> None:
    """The page where the robot walks; without node and npm the first page stays what `docs/site/index.html` is."""
    if (tools := browser_tools.install()) is None:
        say(f"docs: without the page that walks in the browser: {browser_tools.missing()}")
        return
    from rabbit_in_browser.build import BuildError, build_page

    say("docs: the page that walks in the browser")
    try:
        build_page(SITE, tools.zig, tools.daqp, tools.mujoco, tools.cache)
    except BuildError as error:
        raise SetUpError(str(error)) from error


def build() -> None:
    """Build the whole site.

    Raises:
        SetUpError: a command failed, Sphinx warned, or a page asks something of another host.
    """
    install_sphinx()
    say("docs: pages")
    shutil.rmtree(SITE, ignore_errors=True)
    paths = [str(SPHINX), *filter(None, [os.environ.get("PYTHONPATH")])]
    options = ["--quiet", "--fail-on-warning", "--nitpicky", "--conf-dir", "docs", "--doctree-dir", str(STATE / "docs")]
    command = [sys.executable, "-m", "sphinx", *options, str(ROOT), str(SITE)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    if subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode:
        raise SetUpError("Sphinx warned or failed: see the lines above")
    build_first_page()
    if found := outside_requests(SITE):
        raise SetUpError(f"pages that ask something of another host: {'; '.join(found)}")
    say(f"docs: {SITE.relative_to(ROOT)}/index.html")


if __name__ == "__main__":
    main(build, "docs")
