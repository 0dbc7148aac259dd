"""What docstrings and docs/architecture.md name is there: modules, functions, fields, parameters."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "ros2_ws" / "src"
FOLDERS = (SOURCES, *(ROOT / name for name in ("studies", "qa", "scripts", "examples")))
CODE = [path for folder in FOLDERS for path in sorted(folder.rglob("*.py"))]
DATA = [
    path
    for kind in ("msg", "srv", "yaml", "xml", "js", "urdf")
    for place in FOLDERS
    for path in sorted(place.rglob(f"*.{kind}"))
]
SNAKE = re.compile(r"(?<![\w./-])[a-z]{3,}(?:_[a-z]{3,})+(?![\w/(-])")  # longer words than a symbol's, as `eta_b`
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
SYMBOLS = {
    "barrier_offset",
    "eta_last",
    "last_state",
    "next_tick",
    "scale_alpha",
    "scale_beta",
}  # in formulas
OTHERS = {"pybullet_utils"}  # of other projects


def docstrings(tree: ast.Module) -> Iterator[ast.Constant]:
    """The docstrings of a module, its classes and functions."""
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            statement = node.body[0]
            assert isinstance(statement, ast.Expr)
            assert isinstance(statement.value, ast.Constant)
            yield statement.value


def names(tree: ast.Module) -> Iterator[str]:
    """The words of a module's code, and of its texts that are no docstrings."""
    told = {id(each) for each in docstrings(tree)}
    for node in ast.walk(tree):
        for field in ("id", "attr", "arg", "name", "module", "asname"):
            yield from re.findall(r"\w+", str(getattr(node, field, "")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in told:
            yield from re.findall(r"\w+", node.value)


def test_docstrings_name_what_is_there() -> None:
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in CODE}
    known = {name for tree in trees.values() for name in names(tree)} | SYMBOLS | OTHERS
    known |= {part for path in (*CODE, *DATA, *SOURCES.rglob("*")) for part in (path.stem, *path.parts)}
    known |= {word for path in DATA for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    wrong = [
        f"{path.relative_to(ROOT)}: {word}"
        for path, tree in trees.items()
        for text in docstrings(tree)
        for word in SNAKE.findall(re.sub(r"\[.*?\]", "", str(text.value)))  # in brackets are the paper's labels
        if word not in known
    ]
    assert not wrong, "\n".join(wrong)


def test_the_architecture_page_names_the_files_that_are_there() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    folders = {"The core, file by file": "cbf_clf_qp", "The controller, file by file": "rl_cbf_clf_controller"}
    for heading, package in folders.items():
        section = page.split(f"## {heading}\n")[1].split("\n## ")[0]
        rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
        listed = [name for row in rows for name in re.findall(r"`(\w+)/?`", row)]
        folder = SOURCES / package / package
        assert {path.stem for path in folder.glob("*.py")} - {"__init__"} <= {*listed}, heading
        missing = [name for name in listed if name != package and not list(folder.glob(f"**/{name}*"))]
        assert missing == [], heading
