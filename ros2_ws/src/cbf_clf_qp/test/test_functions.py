"""Building in several threads."""

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

from cbf_clf_qp.functions import built_once, one_at_a_time

THREADS = 4


class Owner:
    building = 0
    made = 0

    @built_once
    def function(self) -> int:
        assert Owner.building == 0, "two threads build at a time"
        Owner.building += 1
        time.sleep(0.01)
        Owner.building -= 1
        Owner.made += 1
        return Owner.made


def test_one_thread_builds_at_a_time_and_none_waits_for_ever() -> None:
    """Some build an owner, whose making reads what another owner has built; the others read at once."""
    owners, together = [Owner() for _ in range(THREADS)], Barrier(THREADS)

    @one_at_a_time
    def built_within(owner: Owner) -> int:
        return owner.function

    def read(number: int) -> tuple[int, int]:
        together.wait()
        owner = owners[number]
        return built_within(owner) if number % 2 else owner.function, owner.function

    with ThreadPoolExecutor(THREADS) as pool:
        found = [each.result(timeout=30) for each in [pool.submit(read, number) for number in range(THREADS)]]
    assert sorted(found) == [(i, i) for i in range(1, THREADS + 1)], "each was built once"
