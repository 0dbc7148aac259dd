"""Figures of the pages are those of the shipped tables, and the tables those of their courses."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from rabbit_benchmark.table import Table
from rabbit_experiments.summary import wilson

ROOT = Path(__file__).resolve().parents[2]
PAGES = (
    "README.md",
    "docs/results.md",
    *(f"studies/docs/{each}.md" for each in ("results_paper", "structure", "tuning")),
)
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


@pytest.mark.parametrize("path", TABLES, ids=lambda path: path.stem)
def test_a_table_says_what_its_courses_say(path: Path) -> None:
    for row in Table.read(path).rows.values():
        if row.by_course:
            walked, courses = sum(row.outcomes), len(row.by_course)
            assert (row.walked, row.courses, row.low, row.high) == (walked, courses, *wilson(walked, courses)), row
