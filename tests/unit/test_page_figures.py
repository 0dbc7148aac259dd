"""Figures of the pages are those of the shipped tables, and the tables those of their courses."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from rabbit_benchmark.table import Table
from rabbit_experiments.summary import wilson

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/results.md", "studies/docs/structure.md", "studies/docs/tuning.md")
DATA = ROOT / "studies" / "docs" / "data"
TABLES = sorted(path for path in DATA.glob("*.csv") if path.stem != "mass_courses")  # which has no counts beside


@pytest.fixture(scope="module")
def scripts() -> Iterator[tuple[ModuleType, ModuleType]]:
    """What finds figures on a page, and what the tables say of the pages."""
    sys.path.insert(0, str(ROOT / "scripts"))
    import page_figures
    import shipped_figures

    yield page_figures, shipped_figures
    sys.path.remove(str(ROOT / "scripts"))


@pytest.mark.parametrize("name", PAGES)
def test_figures_are_those_of_the_tables(scripts, name: str) -> None:
    figures, shipped = scripts
    text = (ROOT / name).read_text(encoding="utf-8")
    assert text.splitlines() == figures.made(text, shipped.pages()[name]).splitlines(), "make figures writes them"


@pytest.mark.parametrize("name", PAGES)
def test_each_count_of_courses_has_a_source(scripts, name: str) -> None:
    figures, shipped = scripts
    assert figures.left_out((ROOT / name).read_text(encoding="utf-8"), shipped.pages()[name]) == []


def test_a_wrong_figure_is_mended_and_an_unknown_one_is_found(scripts) -> None:
    figures, _ = scripts
    page = figures.Page(["it walks 8 of 20, +3 (# to #)"], {"rows": "| 2 |"}, {"Tried": "by hand"})
    text = "It\nit\nwalks 9 of 18, -1 (-4 to +2).\n<!-- made: rows --><!-- end -->\n## Tried\n3 of 4\n"
    mended = figures.made(text, page)
    assert mended.startswith("It\nit\nwalks 8 of 20, +3 (-4 to +2).\n<!-- made: rows -->\n\n| 2 |\n\n<!-- end -->")
    assert figures.made(mended, page) == mended
    assert figures.left_out(text, page) == []
    (left,) = figures.left_out(text, figures.Page([], page.blocks, page.elsewhere))
    assert "9 of 18" in left
    for absent in (
        figures.Page(["it walks 8 of 20 steps"]),
        figures.Page(["8 of 20"]),
        figures.Page([], {"other": ""}),
    ):
        with pytest.raises(figures.FigureError, match="expected once"):
            figures.made(text, absent)


@pytest.mark.parametrize("path", TABLES, ids=lambda path: path.stem)
def test_a_table_says_what_its_courses_say(path: Path) -> None:
    for row in Table.read(path).rows.values():
        if row.by_course:
            walked, courses = sum(row.outcomes), len(row.by_course)
            assert (row.walked, row.courses, row.low, row.high) == (walked, courses, *wilson(walked, courses)), row
