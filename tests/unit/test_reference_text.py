"""The site's reference pages name every command, option, parameter, message and module."""

import sys
from pathlib import Path

import pytest
from rabbit_bringup.cli import commands as subcommands

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
