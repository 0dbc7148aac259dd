"""The site that `make docs` builds: the Markdown pages of the repository, its commands and its docstrings.

The source folder is the repository itself, so a link of a page works on the site as it does in the repository. The
first page is the README; its table of contents is `docs/site/contents.md`.
"""

import re
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent

project = "RABBIT on stepping stones"
author = "the contributors"
language = "en"
root_doc = "README"
include_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/**", "ros2_ws/src/cbf_clf_qp/README.md"]
exclude_patterns = [
    ".*",
    "docs/build",
    "docs/site",
    "docs/reproduced/*/**",  # tables that docs/reproduced/results.md shows
    "ros2_ws/build",
    "ros2_ws/install",
    "ros2_ws/log",
    "runs",
]

extensions = ["myst_parser", "sphinx.ext.autodoc"]
myst_heading_anchors = 4

html_theme = "furo"
html_title = project
html_copy_source = False
html_show_sourcelink = False
html_extra_path = ["site/index.html"]  # opens the first page
WALK = HERE.parent / ".setup" / "docs" / "walk.html"  # by scripts/build_docs.py
if WALK.is_file():
    html_extra_path.append(str(WALK))
PICTURE = re.compile(r"^!\[[^]]*\]\(docs/pictures/walk.png\)\n\n\*[^*]*\*\n", re.MULTILINE)


def make_first_page(_app: Sphinx, page: str, source: list[str]) -> None:
    """The README with a walk to drag in place of its picture, and with the table of contents."""
    if page == root_doc:
        text = source[0]
        if WALK.is_file():
            text = PICTURE.sub((HERE / "site" / "walk.md").read_text(encoding="utf-8"), text, count=1)
        source[0] = text + "\n" + (HERE / "site" / "contents.md").read_text(encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Register what is ours."""
    app.connect("source-read", make_first_page)
