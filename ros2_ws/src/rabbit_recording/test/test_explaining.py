"""A recorded tick explained: the rows are those that were recorded; what cannot be explained is refused in one line."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_recording import RecordingError
from rabbit_recording.commands.bag import app
from rabbit_recording.explaining import explain_tick
from rabbit_recording.reader import last_episode
from recorded_walk import DRAWS
from typer.testing import CliRunner, Result

WriteBag = Callable[..., Path]


def rabbit(*words: object) -> Result:
    """`rabbit bag explain` in this process."""
    return CliRunner().invoke(app, ["explain", *map(str, words)])


@pytest.mark.parametrize("tick", [0, 30, 60])
def test_the_rows_are_those_that_were_recorded(tmp_path: Path, write_bag: WriteBag, tick: int) -> None:
    """So are the values of the model. Bounds leave the recorded margin where a row has no slack."""
    told = explain_tick(bag := write_bag(tmp_path / "bag"), tick)
    output, explained = last_episode(bag).records[tick].output, told.explanation.rows
    assert (told.changed == ["it is the first"]) == (tick == 0)
    assert tuple(row.name for row in explained) == output.rows
    np.testing.assert_array_equal([row.slack for row in explained], output.slacks)
    np.testing.assert_array_equal([row.multiplier for row in explained], output.multipliers)
    margins = np.array([min(row.value - row.lower, row.upper - row.value) for row in explained])
    met = output.slacks == 0
    sizes = 1 + np.abs([row.value for row in explained])
    np.testing.assert_allclose((margins / sizes)[met], (output.margins / sizes)[met], atol=1e-9)
    np.testing.assert_allclose(
        [row.gives_way for row in explained], np.where(met, 0, -margins), atol=1e-9 * sizes.max()
    )
    rows = {row.name: row for row in explained}
    nominal = dict(zip(output.quantities, output.nominal_a @ output.mu_qp + output.nominal_b, strict=True))
    for row, quantity in (("CLF", "V"), ("B1", "B1"), ("B2", "B2"), ("C1", "C1")):
        assert rows[row].nominal == pytest.approx(nominal[quantity], rel=1e-9)
        assert rows[row].estimated == 0  # the zero policy
    assert rows["u1"].upper == 200


@DRAWS
def test_the_command_explains_and_draws(tmp_path: Path, write_bag: WriteBag) -> None:
    bag, picture = write_bag(tmp_path / "bag"), tmp_path / "tick.png"
    done = rabbit(bag, "--tick", 30, "--picture", picture)
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[:-1] == explain_tick(bag, 30).lines()
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "slack" in rabbit(bag, "--worst").output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--tick", 9999], "tick 9999 of episode 1: expected one that was recorded, 0 to "),
        ([], "expected --tick N or --worst"),
        pytest.param(["--tick", 3, "--picture", "tick.nothing"], "'nothing' is not supported", marks=DRAWS),
    ],
)
def test_what_is_not_there_is_refused(tmp_path: Path, write_bag: WriteBag, words: list[object], said: str) -> None:
    done = rabbit(write_bag(tmp_path / "bag"), *words)
    assert (done.exit_code, "Traceback" in done.output) == (2, False)
    assert said in " ".join(done.output.split())


DETAILS = ("controller_state", "learner_terms", "controller_settings")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda topic, m: None if topic in DETAILS else m, "its controller publishes no controller_state"),
        (lambda topic, m: None if topic == "state" and m.tick == 5 else m, "tick 5 is missing"),
        (lambda topic, m: None if topic == "controller_settings" else m, "the controller's parameters are not in it"),
        (lambda topic, m: turned(m, 1.0) if topic == "torque" else m, "its replay is off by 1 N m"),
        (lambda topic, m: turned(m, 1e-5) if topic == "torque" else m, "its replay is off by 1e-05 N m"),
    ],
)
def test_what_cannot_be_replayed_is_refused(tmp_path: Path, write_bag: WriteBag, change: Any, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        explain_tick(write_bag(tmp_path / "bag", change=change), 20)


def turned(message: Any, by: float) -> Any:
    """A torque that no replay gives."""
    message.torque = message.torque + by
    return message
