"""The exit codes of a walk: which counts of several, and one table in code, docs and `--help`."""

import re
import subprocess
import sys
from pathlib import Path

from rabbit_common.exit_codes import MEANINGS, OF_THE_GRAPH, ExitCode, of_walk
from rabbit_sim.simulation import Outcome

PAGE = (Path(__file__).parents[2] / "docs" / "operations.md").read_text(encoding="utf-8")
WHILE_IT_RUNS = {Outcome.IDLE, Outcome.RUNNING}


def test_every_outcome_of_the_robot_is_walked_or_fell() -> None:
    for outcome in set(Outcome) - WHILE_IT_RUNS:
        assert of_walk([outcome.value]) is (ExitCode.WALKED if outcome is Outcome.WALKED else ExitCode.FELL)
        assert outcome is Outcome.WALKED or outcome.value in MEANINGS[ExitCode.FELL]
    assert {of_walk([outcome]) for outcome in OF_THE_GRAPH} == {ExitCode.FAULT}


def test_docs_and_help_have_the_same_table() -> None:
    command = [sys.executable, "-c", "from rabbit_bringup.cli import app; app()", "walk", "--help"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=180).stdout
    said = " ".join(re.sub(r"[│╭╰─]", " ", shown).split())
    for code, text in MEANINGS.items():
        assert f"| {code.value} | {code.word} | {text} |" in PAGE
        assert f"{code.value} {code.word}: {text}" in said
