"""The site's reference pages name every command, option, parameter, message and module."""

import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.fixture(scope="module")
def text():
    """The module that writes the pages."""
    sys.path.insert(0, str(SCRIPTS))
    import reference_text

    yield reference_text
    sys.path.remove(str(SCRIPTS))


def test_the_tables_of_the_page_on_topics_are_those_of_the_code(text) -> None:
    """`python scripts/reference_text.py` writes them."""
    page = (SCRIPTS.parent / "docs" / "topics.md").read_text(encoding="utf-8")
    assert text.GENERATED.findall(page)
    assert text.with_tables(page) == page
