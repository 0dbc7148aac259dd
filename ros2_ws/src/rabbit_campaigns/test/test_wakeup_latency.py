"""The process that only sleeps: it counts its ticks, and ends with what it stands beside."""

import math
import time

from rabbit_campaigns.wakeup_latency import Counts, sleeper


def test_it_counts_as_long_as_something_runs_beside_it() -> None:
    with sleeper(0) as counts:
        while math.isnan(counts.late_share):
            time.sleep(0.01)
        assert 0.0 <= counts.late_share <= 1.0


def test_the_share_is_of_the_ticks() -> None:
    assert Counts([400, 3]).late_share == 3 / 400
