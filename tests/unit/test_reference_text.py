"""The site's reference pages name every command, option, parameter, message and module."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rabbit_bringup.cli import commands as subcommands
from rabbit_bringup.cli import loaded

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.fixture(scope="module")
def text():
    """The module that writes the pages."""
    sys.path.insert(0, str(SCRIPTS))
    import reference_text

    yield reference_text
    sys.path.remove(str(SCRIPTS))


def test_every_command_has_a_section_with_its_options(text) -> None:
    page = text.commands()
    for name in subcommands():
        assert f"## rabbit {name}\n" in page
    assert "### rabbit bag check\n" in page
    assert "| `--mass-scale NUMBER` |" in page


def test_every_parameter_has_a_row_with_its_meaning(text) -> None:
    page = text.parameters()
    for models in text.NODES.values():
        for model in models:
            assert all(f"| `{name}` |" in page for name in model.model_fields)
    assert "|  |\n" not in page + "\n"  # no empty meaning
    assert "`> 0" in page


def test_every_message_and_service_is_shown(text) -> None:
    page = text.messages()
    for path in (text.SOURCES / "rabbit_msgs").glob("*/*"):
        assert f"## {path.stem}\n" in page


def test_the_tables_of_the_page_on_topics_are_those_of_the_code(text) -> None:
    """`python scripts/reference_text.py` writes them."""
    page = (SCRIPTS.parent / "docs" / "topics.md").read_text(encoding="utf-8")
    assert text.GENERATED.findall(page)
    assert text.with_tables(page) == page


def test_the_api_has_modules_but_no_commands_and_nodes(text) -> None:
    names = set(text.modules("rl_trainer"))
    assert {"rl_trainer", "rl_trainer.ddpg"} <= names
    assert not [name for name in names if ".ros" in name or ".commands" in name]


def taken(name: str, command: Any) -> Iterator[tuple[str, str]]:
    """Each argument and option of a command and of its subcommands, and what its help says."""
    for inner, each in getattr(command, "commands", {}).items():
        yield from taken(f"{name} {inner}", each)
    for each in command.params:
        each.hidden = False
        flag, text = each.get_help_record(command.make_context(name, [], resilient_parsing=True)) or ("", "")
        yield f"rabbit {name} {flag}", text


@pytest.mark.parametrize("name", subcommands())
def test_help_has_one_form(name: str) -> None:
    """A subject, not `of the payload`; `(default: 10)`; no machine's names of types."""
    for what, text in taken(name, loaded(subcommands()[name])):
        assert re.match(r"(?!(of|in|at|by|for|that|those|which|from|with|over|after|the same)\b)\w", text), (what, text)
        assert "[default" not in text, (what, text)
        assert not re.search(r"\(default [^:]", text), (what, text)
        assert not re.search(r"--\S+ <", what), what


def test_a_page_that_is_made_with_the_site_says_where_its_sources_are() -> None:
    folder = SCRIPTS.parent / "docs" / "reference"
    made = [path for path in folder.rglob("*.md") if "```{reference}" in path.read_text(encoding="utf-8")]
    assert len(made) > 10
    for path in made:
        assert re.search(r"\]\((\.\./)?README\.md\)", path.read_text(encoding="utf-8")), path
