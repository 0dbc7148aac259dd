"""The process that only sleeps: it counts its ticks, and ends with what it stands beside."""

import math
import time

from rabbit_campaigns.wakeup_latency import sleeper


def test_it_counts_as_long_as_something_runs_beside_it() -> None:
    with sleeper(0) as late_share:
        while math.isnan(late_share()):
            time.sleep(0.01)
        assert 0.0 <= late_share() <= 1.0
