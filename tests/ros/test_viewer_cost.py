"""The measure of what a viewer costs a graph: the median's interval, and one pair of walks."""

import json
import subprocess
import sys
from pathlib import Path

from rabbit_campaigns.ros.viewer_cost import PROCESSOR, RATE, median

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")


def test_the_medians_interval_is_one_of_order_statistics() -> None:
    """Of 11 fair coins at most 1 falls heads with probability 12 / 2048, at most 2 with 67 / 2048 > 2.5%."""
    assert median([float(each) for each in range(11)]) == {"median": 5.0, "interval": [1.0, 9.0]}
    assert median([1.0, 2.0, 4.0]) == {"median": 2.0, "interval": None}


def test_a_pair_of_walks_is_measured(tmp_path: Path) -> None:
    words = ("--viewer", "--pairs", "1", "--out", str(tmp_path / "bench.json"))
    done = subprocess.run([*RABBIT, "bench", *words], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("pair 1 of 1: processor time a tick times ")
    ratios = json.loads((tmp_path / "bench.json").read_text())["viewer"]["ratios"]
    for name in (PROCESSOR, RATE):
        (ratio,) = ratios[name]["pairs"]
        assert ratio == ratios[name]["median"] > 0
