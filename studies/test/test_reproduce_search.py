"""The search over settings: how far from the gate, what it begins with, that it goes on, and what it leaves."""

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rabbit_experiments.metrics import RunRow
from rabbit_experiments.summary import Walks
from rabbit_reproduce.search import BOX, GATE, OURS, STARTS, SearchError, far, judged, search
from rabbit_reproduce.setting import Setting, read_setting

Judge = Callable[[Setting, Path, int], tuple[float, list[str]]]


def walks(*stones: int) -> Walks:
    """Runs that came so far, of 20."""
    values: dict[str, Any] = {**dict.fromkeys(RunRow.model_fields, 0), "outcome": "walked"}
    return Walks([RunRow.model_validate({**values, "stones": each, "success": each == 20}) for each in stones])


def test_a_line_that_has_to_walk_is_the_nearer_the_further_it_walks() -> None:
    distances = [far(walks(0, 0, each), 20, True) for each in range(21)]
    assert distances == sorted(distances, reverse=True)
    assert distances[0] == 1.0
    assert 0 < far(walks(20, 20, 19), 20, True) < 0.02
    assert far(walks(20, 20, 20), 20, True) == 0.0


def test_a_line_that_has_to_fall_is_right_as_soon_as_it_does() -> None:
    assert far(walks(20, 20, 20), 20, False) == 1.0
    assert far(walks(20, 20, 19), 20, False) == far(walks(0, 0, 0), 20, False) == 0.0
    nine_of_ten = walks(*[20] * 9, 10)
    assert far(nine_of_ten, 20, False) == pytest.approx(0.95)


def test_no_wrong_line_counts_as_right() -> None:
    faulty = Walks([walks(20).rows[0].model_copy(update={"success": False})])
    assert far(faulty, 20, True) > 0


def test_where_the_gate_is_shut_nothing_is_trained(tmp_path: Path) -> None:
    slow = Setting(plant="rigid", controller={"eps": 1.0})
    score, held = judged(slow, tmp_path, 1)
    assert -len(GATE) <= score < 0
    assert held == []
    assert read_setting(tmp_path / "setting.yaml") == slow
    assert not (tmp_path / "training").exists()


def near_a_fifteenth(setting: Setting, _: Path, __: int) -> tuple[float, list[str]]:
    """In place of walks, a score with one maximum: eps = 1 / 15."""
    return -abs(math.log(15 * setting.controller["eps"])), [f"eps is {setting.controller['eps']}"]


def trials_of(folder: Path) -> list[dict[str, str]]:
    """The table."""
    with (folder / "trials.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_it_begins_with_what_was_chosen_and_keeps_the_best(tmp_path: Path) -> None:
    number, said = len(STARTS) + 4, []
    best = search(number, "rigid", tmp_path, 1, said.append, near_a_fifteenth)
    rows = trials_of(tmp_path)
    assert len(rows) == len(said) == number
    for row, changes in zip(rows, STARTS, strict=False):
        begun = OURS | changes
        assert row["controller.gait"] == begun["controller.gait"]
        for name in BOX.keys() - {"controller.gait"}:
            assert float(row[name]) == pytest.approx(begun[name])
    distances = [abs(math.log(15 * float(row["controller.eps"]))) for row in rows]
    assert [float(row["claims"]) for row in rows] == pytest.approx([-each for each in distances])
    setting = read_setting(best)
    assert abs(math.log(15 * setting.controller["eps"])) == pytest.approx(min(distances))
    assert setting.plant == "rigid"


def test_a_search_that_was_stopped_goes_on_to_the_same_trials(tmp_path: Path) -> None:
    number = len(STARTS) + 4
    search(number, "rigid", tmp_path / "whole", 1, str, near_a_fifteenth)
    for stop in (2, len(STARTS) + 2):
        folder, judge = tmp_path / f"stopped {stop}", stopping_at(stop)
        with pytest.raises(KeyboardInterrupt):
            search(number, "rigid", folder, 1, str, judge)
        search(number, "rigid", folder, 1, str, judge)
        names = ["setting", "claims", *BOX]
        assert [[row[name] for name in names] for row in trials_of(folder)] == [
            [row[name] for name in names] for row in trials_of(tmp_path / "whole")
        ]
        before = (folder / "trials.csv").read_bytes()
        search(number, "rigid", folder, 1, str, judge)  # nothing is left to do
        assert (folder / "trials.csv").read_bytes() == before


def stopping_at(stop: int) -> Judge:
    """The same judge, stopped once, within trial `stop`."""
    calls = iter(range(10**6))

    def judge(setting: Setting, out: Path, processes: int) -> tuple[float, list[str]]:
        if next(calls) == stop:
            raise KeyboardInterrupt
        return near_a_fifteenth(setting, out, processes)

    return judge


def test_a_folder_is_of_one_plant(tmp_path: Path) -> None:
    search(1, "rigid", tmp_path, 1, str, near_a_fifteenth)
    with pytest.raises(SearchError, match="--plant mujoco: expected rigid"):
        search(2, "mujoco", tmp_path, 1, str, near_a_fifteenth)


def test_every_start_is_a_setting_in_the_box() -> None:
    assert STARTS[0] == {}  # ours
    for changes in STARTS:
        for name, value in (OURS | changes).items():
            low, high = BOX[name][0], BOX[name][-1]
            assert value in BOX[name] if isinstance(value, str) else low <= value <= high, name
