"""Real time through the nodes: a controller that dies is held for, then the joints are damped, then it ends, by ticks.

Real time is slowed down (`pace`), so that a busy machine keeps it.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_common.priority import NICE
from rabbit_msgs.msg import Timing, TorqueCommand
from std_srvs.srv import SetBool

PACE, HELD, DAMPED, DAMPING = 0.1, 2, 10, 10.0
PLANT: dict[str, Any] = {"motor_lag": 0.004, "stones": 20}
SLOW: dict[str, Any] = {"real_time": True, "pace": PACE, "damping": DAMPING, "damped_ticks": DAMPED, **PLANT}


def test_a_killed_controller_is_held_for_two_ticks_then_damped_then_it_ends(world: Any) -> None:
    states, timings, torques = (world.hear(topic) for topic in ("state", "timing", "torque"))
    world.walk(**SLOW)
    world.wait(lambda: len(timings) >= 5)
    world.processes.kill(["controller"])
    ended = world.ended()
    world.wait(lambda: states[-1].tick == ended.tick and len(timings) == ended.tick)

    sources = [t.source for t in timings]
    last = max(i for i, source in enumerate(sources) if source == Timing.ANSWER)
    assert sources[last + 1 :] == [Timing.HELD] * HELD + [Timing.DAMPING] * DAMPED
    assert [t.tick for t in timings] == list(range(ended.tick))
    assert ended.outcome == "silent"
    assert ended.tick == last + 1 + HELD + DAMPED

    by_tick = {state.tick: state for state in states}
    answer = {last: by_tick[last + 1].applied}  # the killed controller may not have said its last word to the test
    answer |= {t.tick: np.array(t.torque) for t in torques}
    for tick in range(1, ended.tick + 1):  # what each state says of the tick before
        applied, before = by_tick[tick].applied, by_tick[tick - 1]
        if tick - 1 <= last + HELD:
            answered = max(i for i in range(tick) if sources[i] == Timing.ANSWER)
            np.testing.assert_array_equal(applied, answer[answered])
        else:
            np.testing.assert_array_equal(applied, -DAMPING * np.array(before.dq[3:]))


def test_late_torques_are_told_to_the_controller(world: Any) -> None:
    """The test answers in the controller's place, late at one tick: the state says that the last torque acted again."""
    states, timings = world.hear("state"), world.hear("timing")
    world.start("simulator", **SLOW, seed=3)
    world.say("torque", TorqueCommand())  # refused, but the simulator knows now that somebody answers
    assert world.ask(SetBool, "pause", data=False).success
    late = 4
    for tick in range(late + 2):
        world.wait(lambda known=tick: len(states) > known)
        state = states[tick]
        if state.tick != late:
            torque = np.full(4, float(state.tick + 1))
            world.say("torque", TorqueCommand(episode=state.episode, tick=state.tick, torque=torque))
    world.wait(lambda: len(timings) >= late + 2)
    assert [t.source for t in timings[: late + 2]] == [Timing.ANSWER] * late + [Timing.HELD, Timing.ANSWER]
    by_tick = {state.tick: state for state in states}
    assert np.isnan(by_tick[0].applied).all()
    assert [by_tick[tick].applied[0] for tick in range(1, late + 2)] == [1.0, 2.0, 3.0, 4.0, 4.0]
    assert timings[late].age > timings[late - 1].age > 0.0
    assert np.isnan(timings[late].response)


def niceness(pid: int) -> dict[int, int]:
    """Of each thread of a process."""
    lines = {path.parent.name: path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/stat")}
    return {int(thread): int(line.rpartition(")")[2].split()[16]) for thread, line in lines.items()}


def test_who_can_wait_goes_behind_who_cannot(world: Any) -> None:
    """Trainer and recorder do."""
    world.start("simulator", **SLOW)
    world.start("controller")
    world.start("trainer")
    world.start("recorder", path=str(world.folder / "recording"))
    world.go()
    usual, recorder = os.nice(0), world.processes.pid("recorder")
    world.wait(lambda: niceness(recorder)[recorder] != usual)  # once it has heard that the graph walks in real time
    for name, more in {"simulator": 0, "controller": 0, "trainer": NICE, "recorder": NICE}.items():
        pid = world.processes.pid(name)
        threads = niceness(pid)
        assert threads[pid] == usual + more, name  # which runs the node's callbacks
        if name == "trainer":
            assert list(threads.values()).count(usual + NICE) > 1  # the learning's too
            assert usual in threads.values()  # and not the middleware's, which hold locks that others wait for
