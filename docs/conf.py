"""The site that `make docs` builds: the Markdown pages of the repository, its commands and its docstrings.

The source folder is the repository itself, so a link of a page works on the site as it does in the repository. What is
for contributors, of the studies and of the campaigns is in the repository alone. The first page is the README; its
table of contents is `docs/site/contents.md`.
"""

import os
import re
import sys
from itertools import groupby
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "scripts"))

project = "RABBIT on stepping stones"
author = "the contributors"
language = "en"
root_doc = "README"
include_patterns = [
    "README.md",
    "docs/**",
    "ros2_ws/src/cbf_clf_qp/README.md",
    "ros2_ws/src/rabbit_experiments/README.md",
    "ros2_ws/src/rl_cbf_clf_controller/README.md",
]
exclude_patterns = [
    ".*",
    "docs/build",
    "docs/site",
    "docs/architecture.md",
    "docs/ros_conventions.md",
]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
python_maximum_signature_line_length = 90
autodoc_member_order = "bysource"
nitpick_ignore_regex = [("py:.*", ".*")]  # types of other projects have no pages here
myst_heading_anchors = 4

smartquotes = False  # B'' is a second derivative

html_theme = "furo"
html_favicon = "../ros2_ws/src/rabbit_viewer/rabbit_viewer/page/static/icon.svg"
html_title = project
html_copy_source = False
html_show_sourcelink = False
html_extra_path = ["site/index.html", "pictures/walk.html"]  # the first opens the first page, the second is on it
PICTURE = re.compile(r"^\[!\[[^]]*\]\([^)]*walk.gif\)\]\([^)]*walk.html\)\n\n\*[^*]*\*\n", re.MULTILINE)

TO_PAGE = re.compile(r"\[((?:!\[[^]]*\]\([^)]*\)|[^][])+)\]\(([^)\s:#]+)\.md(?:#[^)\s]*)?\)")


def leave_words(app: Sphinx, page: str, source: list[str]) -> None:
    """Leaves only the words of a link to a page that is in the repository alone."""

    def words(link: re.Match[str]) -> str:
        target = Path(app.srcdir, page).parent / link[2]
        is_here = Path(os.path.relpath(target, app.srcdir)).as_posix() in app.env.found_docs
        return link[0] if is_here else link[1]

    source[0] = TO_PAGE.sub(words, source[0])


def make_first_page(_app: Sphinx, page: str, source: list[str]) -> None:
    """The README with a walk to drag in place of its picture, and with the table of contents."""
    if page == root_doc:
        text = PICTURE.sub((HERE / "site" / "walk.md").read_text(encoding="utf-8"), source[0], count=1)
        source[0] = text + "\n" + (HERE / "site" / "contents.md").read_text(encoding="utf-8")


class Reference(SphinxDirective):
    """`{reference} NAME ...`: what the function of that name in `reference_text` makes of its arguments."""

    required_arguments = 1
    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Parses its Markdown."""
        import reference_text

        name, *arguments = self.arguments
        return self.parse_text_to_nodes(getattr(reference_text, name)(*arguments), allow_section_headings=True)


def as_rst(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Docstrings are plain text: code stands in single backticks, and indented lines stay as they are."""
    blocks: list[str] = []
    for indented, block in groupby(lines, lambda line: line.startswith("    ")):
        text = "\n".join(block)
        is_section = bool(blocks) and re.search(
            r"^(Args|Attributes|Raises|Returns|Yields):$", blocks[-1].split("\n")[-1]
        )
        blocks.append(f"\n::\n\n{text}\n" if indented and not is_section else escaped(text))
    lines[:] = "\n".join(blocks).split("\n")


def escaped(text: str) -> str:
    """Plain text with code in backticks as reStructuredText."""
    parts = re.split(r"`([^`]+)`", text)
    parts[::2] = [re.sub(r"([\\*|]|(?<=\w)_(?!\w))", r"\\\1", part) for part in parts[::2]]
    ends = [r"\ " if part[:1].strip() else "" for part in parts[2::2]]  # what follows a literal at once
    parts[1::2] = [f"``{part}``{end}" for part, end in zip(parts[1::2], ends, strict=True)]
    return "".join(parts)


def setup(app: Sphinx) -> None:
    """Register what is ours."""
    app.connect("source-read", make_first_page)
    app.connect("source-read", leave_words)
    app.connect("autodoc-process-docstring", as_rst, priority=400)  # before napoleon
    app.add_directive("reference", Reference)
