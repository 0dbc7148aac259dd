"""The pages of promises: each has a test, and each test that it names is there."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = "".join((ROOT / each / "promises.md").read_text(encoding="utf-8") for each in ("docs", "qa/docs"))
ROWS = re.findall(r"^\| (?!promise)(?!-)(?!--)(.+) \|$", PAGE, re.MULTILINE)
TESTS = re.compile(r"`([\w/]+\.py)::(\w+)`")


def test_every_promise_names_a_test() -> None:
    assert len(ROWS) >= 20
    assert [row for row in ROWS if not TESTS.search(row)] == []


def test_every_named_test_is_there_once() -> None:
    folders = [ROOT / "tests", *ROOT.glob("ros2_ws/src/*/test"), ROOT / "studies/test", ROOT / "qa/test"]
    files = [file for folder in folders for file in folder.rglob("test_*.py")]
    for name, test in TESTS.findall(PAGE):
        found = [file for file in files if file.as_posix().endswith(f"/{name}") and test in functions(file)]
        assert len(found) == 1, f"{name}::{test}"


def functions(file: Path) -> set[str]:
    """The names of all functions of a module, those of its classes too."""
    return {
        node.name for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(node, ast.FunctionDef)
    }
