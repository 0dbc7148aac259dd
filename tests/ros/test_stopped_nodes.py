"""A node that was stopped hears everybody again: through Fast DDS's shared memory, one stop in fifteen ended that."""

import os
import signal
from typing import Any

import pytest
from rabbit_recording.message_header import turn_of
from rclpy.serialization import serialize_message

from .conftest import SHORT

STOPS, SECONDS = 12, 2.0


@pytest.mark.timeout(900)
def test_a_recorder_that_was_stopped_catches_up_each_time(make_world: Any) -> None:
    world = make_world("stopped")
    states, diagnostics = world.hear("state"), world.hear("diagnostics")
    world.start("simulator", **SHORT, episodes=10_000, pace=0.5)
    world.start("controller")
    world.start("recorder", path=str(world.folder / "recording"))
    world.go()

    def recorded() -> tuple[int, int]:
        said = [s for m in diagnostics for s in m.status if s.name.endswith("/recorder")]
        episode, tick = next(v.value for v in said[-1].values if v.key == "episode, tick").split()
        return int(episode), int(tick)

    for _ in range(STOPS):
        os.kill(world.processes.pid("recorder"), signal.SIGSTOP)
        world.spin(SECONDS)
        os.kill(world.processes.pid("recorder"), signal.SIGCONT)
        newest = turn_of(serialize_message(states[-1]))
        world.wait(lambda newest=newest: recorded() >= newest, seconds=60.0)
