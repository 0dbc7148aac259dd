"""What a bar shows beside a long text."""

import re

import pytest
from rabbit_experiments.engine import BAR_WIDTH, progress_bar
from rich.console import Console


@pytest.mark.parametrize("width", [60, 80, 120])
def test_a_long_text_leaves_room_for_bar_number_and_times(width: int) -> None:
    bar, console = progress_bar(), Console(width=width)
    bar.add_task("steps 12, reward V -1.23 B1 -0.5, losses actor 0.1 " * 4, total=18, completed=3)
    with console.capture() as shown:
        console.print(bar.get_renderable())
    (line,) = re.sub(r"\x1b\[[^m]*m", "", shown.get()).splitlines()
    assert re.match(rf"[━╸╺ ]{{{BAR_WIDTH}}} +3/18 +[-0-9]+:[-0-9:]+ +[-0-9]+:[-0-9:]+ steps 12", line), line
    assert len(line.rstrip()) <= width
