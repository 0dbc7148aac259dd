"""What is said of a walk."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rabbit_bringup.commands.walk import figures_of
from rabbit_bringup.launching.walk import WalkOptions, WalkSettings
from rabbit_bringup.launching.walk_report import carry_out
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters


def test_the_bar_says_what_is_known() -> None:
    """Between episodes and in the air there is no force ratio; before a controller is heard, no slack."""
    now = SimpleNamespace(margin=0.012, barriers={"B1": 0.1, "pitch": 0.25}, slack=1.5, ratio=math.nan)
    assert figures_of(now) == "margin 12 mm, pitch 0.250, slack 1.50"
    assert figures_of(SimpleNamespace(margin=math.nan, barriers={}, slack=math.nan, ratio=0.4)) == "force ratio 0.40"


@pytest.mark.parametrize(("refused", "ending"), [("", ""), ("/b 2", "; torques of /b 2 were refused")])
def test_a_walk_between_two_controllers_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: str, ending: str
) -> None:
    walk = WalkSettings(
        folder=tmp_path,
        options=WalkOptions(record=False),
        simulation=SimulationParameters(),
        controller=ControllerParameters(),
        policy="zero",
    )
    episode = {"episode": 1, "seed": 3, "outcome": "walked", "reason": "", "touchdowns": 2, "stones": 2, "tick": 99}

    def run(tell: Any) -> Any:
        tell(SimpleNamespace(**episode, controller="/a 1", refused_controller=refused))
        return SimpleNamespace(seconds=1.0)

    assert carry_out(walk, run) == 0
    first, *_, last = capsys.readouterr().out.splitlines()
    assert last == f"walked: 1 of 1 episodes walked{ending}"
    assert ("two controllers answered: /a 1 walked, torques of /b 2 were refused" in first) == bool(refused)
