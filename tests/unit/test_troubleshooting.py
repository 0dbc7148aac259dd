"""docs/troubleshooting.md has an entry for each class of error that a command can end with."""

import builtins
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
INNER = {"RuntimeError", "ValueError"}  # of Python: a line says which command turned them into one


def sources() -> str:
    """All Python of the packages, without tests."""
    paths = [
        path for places in ("ros2_ws/src/*/*/**/*.py", "studies/**/*.py", "qa/**/*.py") for path in ROOT.glob(places)
    ]
    return "\n".join(path.read_text(encoding="utf-8") for path in paths if "test" not in path.parts)


def test_every_class_of_error_has_an_entry() -> None:
    ours = set(re.findall(r"^class (\w+Error)\(\w*(?:Error|Exception)\)", sources(), re.MULTILINE))
    turned = {name for names in re.findall(r"complaints\(([^()]*)\)", sources()) for name in names.split(", ")}
    errors = ours | {name for name in turned if re.fullmatch(r"[A-Z]\w+", name)}
    assert len(errors) > 20
    assert {name for name in errors - INNER - {"OSError"} if f"`{name}`" not in PAGE} == set()


def test_no_entry_is_of_an_error_that_is_gone() -> None:
    named = set(re.findall(r"`(\w+Error)`", PAGE))
    gone = {name for name in named if f"class {name}(" not in sources()}
    assert gone <= set(vars(builtins))


def test_messages_of_the_page_are_in_the_code() -> None:
    code = sources() + "".join(path.read_text(encoding="utf-8") for path in (ROOT / "scripts").glob("*.py"))
    code = re.sub(r'"\s*\n\s*f?"', "", code + (ROOT / "Makefile").read_text(encoding="utf-8"))
    said = [
        cell
        for cells in re.findall(r"^\|(?: `?[\w`, ]*`? \|| \|)? (`[^|]*`) \|", PAGE, re.MULTILINE)
        for cell in cells.split("`")[1::2]
    ]
    parts = [part.strip(" .:;`") for text in said for part in text.split("...")]
    missing = [part for part in parts if len(part) > 8 and part not in code]
    assert missing == []
