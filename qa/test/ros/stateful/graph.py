"""The running graph with its simulator held between two ticks, so that what happens to it happens at a named tick.

The robot is held by the service `pause`; a step lets it go on for one tick.
"""

import signal
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rabbit_bringup.launching.processes import write_parameters
from rabbit_campaigns.faults.checks import TRAINING, check_recording, check_transitions
from rabbit_campaigns.ros.graph import CampaignGraph, Hang, ros_arguments
from rabbit_common.ros.client import TOPIC
from rabbit_msgs.msg import Episode
from std_srvs.srv import SetBool

from .forked import ForkedProcesses
from .policies import PARAMETERS, PLANT, SEEDS, write_all

NODES = ("simulator", "controller", "trainer", "recorder")
ASKED_AGAIN = 2.0  # s
KNOWN_SECONDS = 0.1  # until a new publisher is known to its readers
LIE_SECONDS = 1.0  # within which a wrong message goes its way
HANG_AFTER = 120.0  # s: a guard against hangs, no bar


class HeldGraph(CampaignGraph):
    """Simulator, controller, trainer and recorder in a namespace of their own, and a node that hears and asks them."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        write_all(folder / "policies")
        self.torques: dict[tuple[int, int], Any] = {}
        self.swaps: list[Any] = []  # of the controller that is there
        self._liars = ExitStack()  # publishers that stay
        self._elsewhere = ForkedProcesses(folder / "elsewhere")
        super().__init__(folder, f"held_{time.time_ns()}", ForkedProcesses(folder / "log"), HANG_AFTER)
        for name in NODES:
            self.start(name)

    def further_topics(self) -> dict[str, Callable[[Any], object]]:
        """Torques by turn, and swaps."""
        return {"torque": lambda m: self.torques.__setitem__((m.episode, m.tick), m), "policy_swap": self.swaps.append}

    def count(self, key: str) -> int:
        """What the controller counts under names that begin so."""
        return self.counted("controller", key)

    @property
    def refused_policies(self) -> list[str]:
        """The reasons that the controller has told."""
        return [swap.reason for swap in self.swaps if not swap.accepted]

    def note(self, rule: str, arguments: dict[str, Any]) -> None:
        """Write down what begins now: a graph that hangs leaves the rules that led there in `rules.txt`."""
        with (self.folder / "rules.txt").open("a", encoding="utf-8") as file:
            file.write(f"{time.strftime('%H:%M:%S')} {self.turn} {rule} {arguments}\n")

    def close(self) -> None:
        """End all."""
        self.processes.kill()
        self._elsewhere.kill()
        super().close()

    # Nodes

    def start(self, name: str, **changes: Any) -> None:
        """Start a node, again or for the first time; the simulator is held."""
        if name == "controller":
            self.swaps.clear()
        super().start(name, **changes)

    def parameters(self, name: str) -> dict[str, Any]:
        """What a node is told."""
        own = {
            "simulator": {"episodes": 1_000_000, "readers": 1 + len(NODES[1:]), "trainer": "wait", "start_paused": True}
            | {"memory": str(self.folder / "simulator.memory"), "answer_timeout": 600.0, **PLANT.model_dump()},
            "controller": PARAMETERS.model_dump(mode="json"),
            "trainer": {"folder": str(self.training), "plan_episodes": False, **TRAINING.model_dump(mode="json")},
            "recorder": {"path": str(self.folder / "recording")},
        }
        return own[name.removesuffix("2")]

    def answer(self, name: str, **fields: Any) -> Any:
        """What a service answers; raises `Hang`."""
        if (answer := self.ask(name, self.hang_after, **fields)) is None:
            raise Hang(f"no answer from {name}")
        return answer

    def lie(self, name: str, data: bytes, stays: bool) -> None:
        """Send wrong bytes; where the publisher `stays`, it does until `silence`."""
        with ExitStack() as liar:
            everybody = self.node.count_subscribers(name)
            publisher = liar.enter_context(self.publishing(name))
            self.comes(lambda: publisher.get_subscription_count() >= everybody, LIE_SECONDS)
            self.spin(KNOWN_SECONDS)
            self.publish_false(publisher, data)
            self.comes(lambda: self.false[data] > 0, LIE_SECONDS)
            if stays:
                self._liars.push(liar.pop_all())

    def silence(self) -> None:
        """Nobody lies any more: what is latched would come again."""
        self._liars.close()
        super().silence()

    # Ticks

    def pause(self, paused: bool) -> None:
        """Hold the robot, or let it go."""
        assert self.answer("pause", data=paused).success

    def let_go(self) -> None:
        """The same, and not wait until it is done."""
        self.client("pause").call_async(SetBool.Request(data=False))

    @property
    def is_running(self) -> bool:
        """Whether an episode is under way."""
        return self.episode.phase in (Episode.RUNNING, Episode.PAUSED)

    def reset(self, seed: int) -> int:
        """Begin an episode, held at tick 0; returns its number."""
        answers: list[Any] = []

        def accepted() -> bool:
            answers.append(self.answer("reset_episode", seed=seed))
            if not answers[-1].success:
                self.spin(0.05)
            return bool(answers[-1].success)

        self.wait("an episode that the simulator accepts", accepted)
        number = int(answers[-1].episode)
        self.wait(f"tick 0 of episode {number}", lambda: (number, 0) in self.heard["state"])
        return number

    def step(self) -> None:
        """One tick: the controller is stopped meanwhile, so that there is no torque for another."""
        now = self.turn
        self.wait(f"the torque of tick {now}", lambda: now in self.torques or not self.is_running)
        self.processes.send("controller", signal.SIGSTOP)
        self.pause(False)
        if not self.comes(lambda: self.turn != now or not self.is_running, ASKED_AGAIN):
            self.processes.send("controller", signal.SIGCONT)  # the simulator asks for the torque again
        self.wait(f"the tick after {now}", lambda: self.turn != now or not self.is_running)
        self.pause(True)
        self.processes.send("controller", signal.SIGCONT)

    def forget(self, before: int) -> None:
        """The ticks and torques of older episodes; how they ended stays known."""
        self.torques = {turn: message for turn, message in self.torques.items() if turn[0] > before}

    # What is left on disk

    def lost_transitions(self) -> int:
        """Of the acknowledged ones those that are nowhere on disk; the trainer must not be running."""
        return check_transitions(self.acknowledged, self.training)["lost"]

    def missing_ticks(self, path: Path, since: float, until: float) -> tuple[int, str]:
        """Ticks heard in a time that are not in a recording, which must be readable; or why it is not."""
        wanted = [turn for turn, at in self.heard["state"].items() if since <= at < until]
        found = check_recording(path, wanted, said=None)  # strangers may be in it
        return found["missing"] if found["readable"] else len(wanted), ", ".join(found["misread"])

    # Another graph

    def walk_elsewhere(self) -> tuple[str, dict[int, bytes]]:
        """Outcome of an episode in another namespace, and its torques by tick, as far as they were heard."""
        namespace = f"elsewhere_{time.time_ns()}"
        ended: list[Episode] = []
        torques: dict[int, bytes] = {}
        hears = {"episode": lambda m: m.phase == Episode.ENDED and ended.append(m)}
        hears |= {"torque": lambda m: torques.__setitem__(m.tick, m.torque.tobytes())}
        for name, hear in hears.items():
            self.node.create_subscription(TOPIC[name].type, f"/{namespace}/{name}", hear, TOPIC[name].qos)
        own = {"simulator": PLANT.model_dump() | {"seed": SEEDS[0]}, "controller": PARAMETERS.model_dump(mode="json")}
        path = self.folder / "elsewhere.yaml"
        write_parameters(path, own)
        for name in own:
            self._elsewhere.start(name, ros_arguments(name, path, namespace))
        self.wait("the end of the walk elsewhere", lambda: bool(ended))
        self._elsewhere.stop()
        for subscription in [each for each in self.node.subscriptions if namespace in each.topic_name]:
            self.node.destroy_subscription(subscription)
        return ended[0].outcome, torques
