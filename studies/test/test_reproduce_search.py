"""The tuner of a setting: what it proposes, that it goes on, and what it leaves."""

from pathlib import Path

import optuna
import pytest
import typer
from optuna.storages.journal import JournalFileBackend, JournalStorage
from optuna.trial import FixedTrial
from rabbit_reproduce import search as module
from rabbit_reproduce.report import Claim, Report, Verdict
from rabbit_reproduce.search import search, suggested
from rabbit_reproduce.setting import read_setting

RANGES = {"controller": {"eps": [0.02, 0.2], "gait": ["stones_0350_080", "stones_0350_084"]}}
TEXT = "controller: {eps: [0.02, 0.2]}"


@pytest.fixture
def ranges(tmp_path: Path) -> Path:
    path = tmp_path / "ranges.yaml"
    path.write_text(TEXT)
    return path


def reports_of(experiments, size, out, *_: object) -> None:
    """In place of walks: one claim, which holds where eps is below 0.05."""
    verdict = Verdict.REPRODUCED if size.setting.controller["eps"] < 0.05 else Verdict.NOT
    name = experiments[0].name
    about = {"name": name, "title": "", "label": "", "paper": "", "quick": True, "retrained": False, "commit": ""}
    claims = (Claim(claim="eps is small", ours="", verdict=verdict),)
    Report(**about, policies={}, claims=claims, tables=(), figures={}).write(out, {})


def test_a_proposal_is_a_setting() -> None:
    trial = FixedTrial({"eps": 0.05, "gait": "stones_0350_084"})
    setting = suggested(trial, RANGES, "rigid")
    assert setting.controller == {"eps": 0.05, "gait": "stones_0350_084"}
    assert setting.plant == "rigid"


def test_a_search_goes_on_and_leaves_the_best_setting(
    ranges: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "make", reports_of)
    out = tmp_path / "out"
    search(ranges, ["stepping-stone"], out, trials=4, plant="rigid")
    search(ranges, ["stepping-stone"], out, trials=12, plant="rigid")
    assert sorted(int(path.name) for path in out.iterdir() if path.name.isdigit()) == list(range(12))
    best = read_setting(out / "best.yaml")
    assert best.plant == "rigid"
    assert best.controller["eps"] < 0.05
    storage = JournalStorage(JournalFileBackend(str(out / "search.log")))
    assert [each.number for each in optuna.load_study(study_name="claims", storage=storage).trials] == list(range(12))


def test_an_unknown_experiment_is_refused(ranges: Path, tmp_path: Path) -> None:
    with pytest.raises(typer.Exit):
        search(ranges, ["nosuch"], tmp_path / "out")
