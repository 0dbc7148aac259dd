"""`make docs` refuses a site with a link that leads nowhere or to a page's Markdown."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def build_docs() -> Iterator[ModuleType]:
    """The module that builds the site."""
    sys.path.insert(0, str(ROOT / "scripts"))
    import build_docs

    yield build_docs
    sys.path.remove(str(ROOT / "scripts"))


def test_links_that_lead_nowhere_are_found(build_docs, tmp_path: Path) -> None:
    good = ["#here", "sub/page.html#there", "a%20file.csv", "https://other.example/x.md", "mailto:a@b.c", "data:,", ""]
    bad = ["#nowhere", "none.html", "sub/page.html#none", "notes.md", "notes.md#there"]
    links = "".join(f'<a href="{each}">x</a>' for each in [*good, *bad, "#settings=1"])
    (tmp_path / "sub").mkdir()
    (tmp_path / "index.html").write_text(f'<link rel="icon" href="no.svg"><h1 id="here">{links}</h1>')
    (tmp_path / "sub" / "page.html").write_text('<a name="there" href="../index.html#here">up</a>')
    (tmp_path / "a file.csv").touch()
    (tmp_path / "notes.md").touch()
    assert build_docs.dead_links(tmp_path) == [f"index.html: {each}" for each in sorted([*bad, "no.svg"])]


def test_the_site_that_was_built_has_none(build_docs) -> None:
    if not (build_docs.SITE / "README.html").is_file():
        pytest.skip("no site here: make docs")
    assert build_docs.dead_links(build_docs.SITE) == []
