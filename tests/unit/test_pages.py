"""The pages: links, programs, commands, promises, figures and tables are those of the project."""

import re
import shlex
import subprocess
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from rabbit_benchmark.table import Table
from rabbit_bringup.cli import chosen, commands, loaded
from rabbit_experiments.summary import wilson

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    ROOT / name
    for name in subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    if (ROOT / name).is_file()
)
FENCE = re.compile(r"^( *)(```+|:::+)(.*?)\n(.*?)^\1\2 *$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def name_of(path: Path) -> str:
    """Path in the repository."""
    return path.relative_to(ROOT).as_posix()


@cache
def anchors(path: Path) -> set[str]:
    """Anchors of a page's headings, made as hosting sites make them."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    found: list[str] = []
    for title in re.findall(r"^#+ (.+)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", title).strip().lower()
        anchor = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        found.append(f"{anchor}-{found.count(anchor)}" if anchor in found else anchor)
    return set(found)


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_links_lead_somewhere(path: Path) -> None:
    text = re.sub(r"`[^`\n]*`", "", FENCE.sub("", path.read_text(encoding="utf-8")))
    for link in LINK.findall(text):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_programs_that_a_page_shows_are_what_runs() -> None:
    shown = re.compile(r"^<!-- from (\S+) -->\n```(?:py|toml|yaml)\n(.*?)^```", re.MULTILINE | re.DOTALL)
    found = [(path, *match) for path in PAGES for match in shown.findall(path.read_text(encoding="utf-8"))]
    assert len(found) >= 10
    for path, file, block in found:
        program = (path.parent / file).read_text(encoding="utf-8")
        outer = [line.removeprefix("    ") for line in program.splitlines()]  # of a class, its methods
        assert block in program or block.rstrip() in "\n".join(outer), f"{name_of(path)}: {file} has another text"


def command_lines() -> list[str]:
    """Each `rabbit ...` of the Makefile, and on a line of its own in a page's code, with the lines that go on."""
    found = set(re.findall(r"^\t.*?(rabbit .*)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for path in PAGES:
        if not name_of(path).startswith(("studies/docs/history/", "qa/docs/history/", "CHANGELOG")):
            text = path.read_text(encoding="utf-8").replace("\\\n", " ")
            found |= set(re.findall(r"^(?:    |```\w*\n)?(?:\$ )?(rabbit (?:[a-z]+ )?.*)$", text, re.MULTILINE))
    return sorted(line for line in found if line.split()[1] in commands())


@cache
def options(name: str, *words: str) -> set[str]:
    """The options of a subcommand, or of a subcommand's own."""
    command = loaded(chosen(name, list(words)))
    for word in words:
        command = getattr(command, "commands", {}).get(word, command)
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)} | {"--help"}


@pytest.mark.parametrize("line", command_lines())
def test_a_command_on_a_page_has_its_options(line: str) -> None:
    words = shlex.split(re.sub(r"\s[|>&;].*", "", line.split(" ## ")[0]), comments=True)[1:]
    ours = words[: words.index("--")] if "--" in words else words
    known = options(*words[:1], *(words[1:] if "--task" in words else words[1:2]))
    assert {word.split("=")[0] for word in ours if word.startswith("--")} <= known


PAGE = "".join((ROOT / folder / "promises.md").read_text(encoding="utf-8") for folder in ("docs", "qa/docs"))
ROWS = re.findall(r"^\| (?!promise)(?!-)(?!--)(.+) \|$", PAGE, re.MULTILINE)
TESTS = re.compile(r"`([\w/]+\.py)::(\w+)`")


def test_every_promise_names_a_test_that_is_there_once() -> None:
    assert len(ROWS) >= 20
    assert [row for row in ROWS if not TESTS.search(row)] == []
    folders = [ROOT / "tests", *ROOT.glob("ros2_ws/src/*/test"), ROOT / "studies/test", ROOT / "qa/test"]
    files = [file for folder in folders for file in folder.rglob("test_*.py")]
    for name, test in TESTS.findall(PAGE):
        found = [file for file in files if file.as_posix().endswith(f"/{name}") and test in functions(file)]
        assert len(found) == 1, f"{name}::{test}"


def functions(file: Path) -> set[str]:
    """The names of all tests of a module."""
    return set(re.findall(r"^def (\w+)", file.read_text(encoding="utf-8"), re.MULTILINE))


WITH_FIGURES = (
    "README.md",
    "docs/results.md",
    *(f"studies/docs/{page}.md" for page in ("results_paper", "results_robots", "structure", "tuning")),
)
DATA = ROOT / "studies" / "docs" / "data"
TABLES = sorted(path for path in DATA.glob("*.csv") if "by_course" in path.read_text(encoding="utf-8").split("\n")[0])


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    """A program that writes or reads the pages, by its name."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return import_module


@pytest.mark.parametrize("name", WITH_FIGURES)
def test_figures_are_those_of_the_tables(scripts, name: str) -> None:
    text, shipped = (ROOT / name).read_text(encoding="utf-8"), scripts("shipped_figures").pages()[name]
    assert text.splitlines() == scripts("page_figures").made(text, shipped).splitlines(), "make figures writes them"


@pytest.mark.parametrize("path", TABLES, ids=lambda path: path.stem)
def test_a_table_says_what_its_courses_say(path: Path) -> None:
    for row in Table.read(path).rows.values():
        if row.by_course:
            walked, courses = sum(row.outcomes), len(row.by_course)
            assert (row.walked, row.courses, row.low, row.high) == (walked, courses, *wilson(walked, courses)), row


def test_the_tables_of_the_page_on_topics_are_those_of_the_code(scripts) -> None:
    """`python scripts/reference_text.py` writes them."""
    text, page = scripts("reference_text"), (ROOT / "docs" / "topics.md").read_text(encoding="utf-8")
    assert text.GENERATED.findall(page)
    assert text.with_tables(page) == page
