"""What the product's pages tell a reader to type is there after `make walk`, or `make studies` stands above it."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from rabbit_bringup.cli import commands

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "ros2_ws/src").glob("*/README.md")),
]
PAGES = [page for page in PAGES if "build" not in page.relative_to(ROOT).parts]
TYPED = re.compile(r"^(?:    )?(?:\w+=\S+ |timeout [\w ]*?\d+ )*(rabbit|python) (\S+)", re.MULTILINE)
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$|((?:^    \S.*\n)+)|`((?:rabbit|python) [^`]+)`", re.MULTILINE | re.DOTALL)
STUDIES = {path.name for place in ("studies", "qa") for path in (ROOT / place).iterdir() if path.is_dir()}
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def product_commands() -> set[str]:
    """Those that the packages of the workspace bring."""
    return {name for name, entry in commands().items() if entry.module.partition(".")[0] not in STUDIES}


def typed(page: Path) -> Iterator[tuple[str, str, str]]:
    """Program and first word of each command on a page, and the text above it."""
    text = page.read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        code = block[2] if block[1] in ("", "bash") else ""
        for program, word in TYPED.findall(code or block[3] or block[4] or ""):
            yield program, word, text[: block.end()]


def needs(example: Path) -> set[str]:
    """Packages of the studies that it imports."""
    tree = ast.parse(example.read_text(encoding="utf-8"))
    names = [each.module or "" for each in ast.walk(tree) if isinstance(each, ast.ImportFrom)]
    names += [alias.name for each in ast.walk(tree) if isinstance(each, ast.Import) for alias in each.names]
    return {name.partition(".")[0] for name in names} & STUDIES


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_command_of_a_page_is_the_products_or_the_studies_are_told_above_it(page: Path) -> None:
    known = product_commands()
    assert known >= {"walk", "evaluate", "system", "bag"}
    for program, word, above in typed(page):
        is_option = word.startswith(("-", "<", "."))
        own = not needs(ROOT / word) if program == "python" and (ROOT / word).is_file() else True
        if program == "rabbit" and word.isalpha() and word.islower():
            own = word in known
        assert own or is_option or "make studies" in above, f"{program} {word}: expected `make studies` above it"


def test_pages_have_commands() -> None:
    assert len([each for page in PAGES for each in typed(page)]) > 60


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_imports_the_product_and_libraries_alone_or_says_what_to_install(example: Path) -> None:
    if not needs(example):
        return
    without = f"import sys; sys.modules.update(dict.fromkeys({sorted(STUDIES)}))"
    code = f"{without}; import runpy; runpy.run_path({str(example)!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert re.fullmatch(r"rabbit_\S+ is not installed: call make studies, .*\n", done.stderr)


def test_the_studies_are_there_where_this_is_tested() -> None:
    assert find_spec("rabbit_gait_design")
