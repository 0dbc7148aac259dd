"""`make docs`: the site in docs/build. Its pages open from disk, without a network.

Its first page, where the robot walks, needs any web server, and node and npm as it is built.
Sphinx and what it needs lie in .setup/sphinx, apart from .venv: the ROS wheels pin a docutils that is too new for it.
"""

import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import browser_tools
from common import ROOT, STATE, SetUpError, digest, is_done, main, mark_done, say
from pip_install import REQUIREMENTS, pip_install

SPHINX = STATE / "sphinx"
SITE = ROOT / "docs" / "build"
REQUEST = re.compile(r"""<(?!a\s)(\w+)\s[^>]*?(?<=\s)(?:src|href|srcset|data)=["']?((?:http|//)[^\s"'>]*)""")


def outside_requests(site: Path) -> list[str]:
    """What the pages of a folder ask of other hosts, as `page: tag address`; links (`a`) are not asked for."""
    return [
        f"{path.relative_to(site)}: {tag} {address}"
        for path in sorted(site.rglob("*.html"))
        for tag, address in REQUEST.findall(path.read_text(encoding="utf-8"))
    ]


class Links(HTMLParser):
    """The addresses that a page links to, and its anchors."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.addresses, self.anchors = set[str](), {"", "top"}
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take in a tag."""
        for name, value in attrs:
            if name == "id" or (tag, name) == ("a", "name"):
                self.anchors.add(value or "")
            elif name == "href" and value and not urlsplit(value).scheme and not value.startswith("//"):
                self.addresses.add(value)


def dead_links(site: Path) -> list[str]:
    """Links to no file or anchor of a site, and to a page's Markdown, which a browser downloads, as `page: address`."""
    pages = {path.resolve(): Links(path) for path in sorted(site.rglob("*.html"))}
    wrong = []
    for page, links in pages.items():
        for address in sorted(links.addresses):
            parts = urlsplit(address)
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            is_anchor = "=" not in parts.fragment  # the first page reads settings there
            anchor_lacks = target in pages and is_anchor and unquote(parts.fragment) not in pages[target].anchors
            if not target.is_file() or target.suffix == ".md" or anchor_lacks:
                wrong.append(f"{page.relative_to(site.resolve())}: {address}")
    return wrong


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
    if why := browser_tools.install():
        say(f"docs: without the page that walks in the browser: {why}")
        return
    from rabbit_in_browser.build import BuildError, build_page

    say("docs: the page that walks in the browser")
    try:
        build_page(SITE, **browser_tools.TOOLS)
    except BuildError as error:
        raise SetUpError(str(error)) from error


def build() -> None:
    """Build the whole site.

    Raises:
        SetUpError: a command failed, Sphinx warned, a page asks something of another host, or a link leads nowhere.
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
    if wrong := outside_requests(SITE):
        raise SetUpError(f"pages that ask something of another host: {'; '.join(wrong)}")
    if wrong := dead_links(SITE):
        raise SetUpError(f"links that lead nowhere, or to a page's Markdown: {'; '.join(wrong)}")
    say(f"docs: {SITE.relative_to(ROOT)}/index.html")


if __name__ == "__main__":
    main(build, "docs")
