"""The exit codes of a walk: which counts of several."""

import pytest
from rabbit_common.exit_codes import ExitCode, of_walk


@pytest.mark.parametrize(
    ("outcomes", "code"),
    [
        (["walked"], ExitCode.WALKED),
        (["walked", "fall", "walked"], ExitCode.FELL),
        (["silent", "fall", "walked"], ExitCode.FAULT),
        (["reset", "walked"], ExitCode.WALKED),  # an operator asked for the second
        (["reset", "miss"], ExitCode.FELL),
        (["walked", "reset"], ExitCode.FAULT),  # nothing followed it
        ([], ExitCode.FAULT),
    ],
)
def test_the_worst_episode_counts(outcomes: list[str], code: ExitCode) -> None:
    assert of_walk(outcomes) is code
