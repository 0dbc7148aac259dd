"""A campaign: fault after fault into a walking graph, a line of JSON for each, until there are so many.

A graph lives for `SESSION` faults, or until something is wrong; then the next one begins. What must hold after a fault:

    the graph goes on: new ticks; new transitions after a trainer's fault, a new recording after a recorder's, which
    catches up where it was stopped
    every transition that the trainer told is on disk
    a recording holds every tick that was told more than a second before its end, also one that began in the middle of
    an episode, and is read as what was heard (`recording_checks`)
"""

import json
import random
import shutil
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from rabbit_bringup.launching.processes import Processes
from rabbit_common.executables import LaunchError

from rabbit_campaigns.faults.checks import TRAINING, check_recording, check_transitions
from rabbit_campaigns.faults.plan import NODES, RESULTS, SECOND, Fault, draw, read_results
from rabbit_campaigns.faults.recording_checks import MonitorRecord
from rabbit_campaigns.ros.graph import CampaignGraph, Hang, Turn
from rabbit_campaigns.ros.wrong_messages import HEARD, wrong_message

SESSION = 40  # faults
HANG = 180.0  # s after which a wait counts as one
Rows = list[dict[str, Any]]
WRONG = ("lost", "missing", "misread")  # what of a row must be nothing
RECORDING_END = 1.0  # s of which a killed recorder may lose all
NEW_TICKS = 3  # after which a graph has recovered
DELIVERY = 0.3  # s in which the witness hears what was told before a node ended
KNOWN_SECONDS, SEND_SECONDS = 0.5, 0.05  # until a new publisher is known to its readers; between wrong messages
SENDERS = ("simulator", "controller")  # of a tick's messages; one that is killed may have sent to some readers only
FULL = {"recorder": "recording stopped", "trainer": "not kept any more"}  # what a node says of a full disk
PLANT = {"motor_lag": 0.004, "mass_scale": 1.2, "stones": 3, "stop_at_miss": False}
WALK = {
    "episodes": 1_000_000,
    "readers": 4,  # of the state: controller, trainer, recorder, witness; a simulator that comes back waits for them
    "trainer": "follow",
    "pace": 0.1,  # times real time: most of the processor is for nodes that begin
    "answer_timeout": 2.0,
    "trainer_timeout": 60.0,
}


def run_campaign(out: Path, runs: int, seed: int, show: Callable[[dict[str, Any]], None]) -> Rows:
    """Inject faults until there are `runs` lines in OUT/faults.jsonl; returns all of them.

    Raises:
        LaunchError: the nodes cannot be started, or do not begin to walk.
    """
    out.mkdir(parents=True, exist_ok=True)
    rows = read_results(out)
    (out / RESULTS).write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    session = 1 + max((int(path.name.split("-")[1]) for path in out.glob("session-*")), default=0)
    while len(rows) < runs:
        faults = [draw(seed, number) for number in range(len(rows), min(len(rows) + SESSION, runs))]
        rows += run_session(out, session, faults, show)
        session += 1
    return rows


def run_session(out: Path, number: int, faults: Sequence[Fault], show: Callable[[dict[str, Any]], None]) -> Rows:
    """One graph and its faults; it ends early where something was wrong."""
    rows: list[dict[str, Any]] = []
    with closing(FaultyGraph(out / f"session-{number:03d}", number)) as graph:
        graph.begin()
        for fault in faults:
            rows.append({"session": number, **graph.inject(fault)})
            with (out / RESULTS).open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
            show(rows[-1])
            if not rows[-1]["passed"]:
                return rows
    shutil.rmtree(graph.folder)  # of interest only where something was wrong
    return rows


class FaultyGraph(CampaignGraph):
    """Short walks without end, learned from between them; injects faults and looks at what comes of them."""

    def __init__(self, folder: Path, seed: int) -> None:
        folder.mkdir(parents=True)
        self._seed = seed
        self._halved = frozenset[Turn]()  # ticks in which simulator or controller was killed
        self._has_strangers = False  # in the present recording: messages of nobody's, which say what they like
        super().__init__(folder, f"faults_{time.time_ns()}", Processes(folder / "log"), HANG)

    def parameters(self, name: str) -> dict[str, Any]:
        """Parameters of a node."""
        told: dict[str, dict[str, Any]] = {
            "simulator": {"seed": self._seed, "memory": str(self.folder / "simulator.memory"), **WALK, **PLANT},
            "controller": {"controller": str(TRAINING.problem), "swap_at": "episode"},
            "trainer": {"folder": str(self.training), **TRAINING.model_dump(mode="json")},
        }
        return told.get(name) or {"path": str(self.folder / name)}

    def begin(self) -> None:
        """Start the nodes; wait until the robot walks and the trainer learns."""
        for name in NODES:
            self.start(name)
        try:
            self.wait("the first ticks and transitions", lambda: len(self.acknowledged) > 1)
            self.wait("the first recording", lambda: "recorder" in self.recordings)
        except Hang as error:
            raise LaunchError(str(error)) from error

    def close(self) -> None:
        """End all nodes, those that others listen to first."""
        self.processes.stop(("simulator", "controller"))
        self.processes.stop()
        super().close()

    def inject(self, fault: Fault) -> dict[str, Any]:
        """One fault; its row says whether all held."""
        about = {"number": fault.number, "kind": fault.kind, "node": fault.node, "seconds": round(fault.seconds, 3)}
        row: dict[str, Any] = {**about, "passed": False, "hang": False, "lost": 0, "error": ""}
        try:
            if fault.node == SECOND:  # a second recorder comes, in the middle of an episode
                self.start(SECOND)
                self.wait("the second recorder", lambda: SECOND in self.recordings)
            self._walk(fault.after_ticks)
            turn, began = self.turn, time.monotonic()
            row["turn"] = list(turn)
            row |= self._do(fault)
            row |= self._recover(fault)
            row["whole_seconds"] = round(time.monotonic() - began, 2)
            ended = self.ended[turn[0]][0] if turn[0] in self.ended else None
            row["episode"] = f"{ended.outcome}: {ended.reason}".strip(": ") if ended else "goes on"
            row["told"] = sorted({text for text in self._warned(began) if "waiting for" in text})[:4]
            row["passed"] = row.get("readable", True) and not any(row.get(name) for name in WRONG)
        except Hang as error:
            row |= {"hang": True, "error": str(error), "told": self._warned(time.monotonic() - 5.0)[-4:]}
        except LaunchError as error:
            row["error"] = f"ended by itself: {error}"
        row["acknowledged"] = len(self.acknowledged)
        return row

    def _walk(self, ticks: int) -> None:
        target = len(self.heard["state"]) + ticks
        self.wait(f"{ticks} ticks", lambda: len(self.heard["state"]) >= target)

    def _warned(self, since: float) -> list[str]:
        return [text for at, text in self.warnings if at >= since]

    def _do(self, fault: Fault) -> dict[str, Any]:
        """The fault itself; returns what was checked while its node was away."""
        name = fault.node
        if fault.kind == "messages":
            before, self._has_strangers = self._refused(), True
            return {"sent": self._mislead(fault), "refused_before": before}
        if fault.kind == "stop":
            self.processes.send(name, signal.SIGSTOP)
            self.spin(max(fault.seconds, DELIVERY))
            found = self._check_disk() if name == "trainer" else {}
            self.processes.send(name, signal.SIGCONT)
            return found
        end = time.monotonic()
        if fault.kind == "terminate":
            self.terminate(name)
        else:
            if fault.kind == "full disk":
                self.limit_files(name, 0)
                self.wait(f"the {name} says: {FULL[name]}", lambda: FULL[name] in self.told_by(name))
                self._walk(10)  # on
            self.processes.kill((name,))
        self.spin(max(0.0 if name == SECOND else fault.seconds, DELIVERY))
        if fault.kind == "kill" and name in SENDERS:
            self._halved |= {self.turn}  # the newest, now that all is heard that was sent
        found = {}
        if name == "trainer":
            found = self._check_disk()
        elif name in self.recordings:
            found = self._check_recording(fault, end)
        if name != SECOND:
            self.start(name)
        return found

    def _refused(self) -> int:
        """Messages that the nodes say they have refused."""
        return sum(self.counted(name, "refused") for name in self.said)

    def _mislead(self, fault: Fault) -> int:
        """Send a node wrong messages for so long; returns how many."""
        rng, sent = random.Random(fault.number), 0
        with ExitStack() as liars:
            publishers = {name: liars.enter_context(self.publishing(name)) for name in HEARD[fault.node]}
            self.spin(KNOWN_SECONDS)
            end = time.monotonic() + fault.seconds
            while time.monotonic() < end:
                if made := wrong_message(rng, fault.node, self.newest):
                    topic, data = made
                    self.publish_false(publishers[topic], data)
                    sent += 1
                self.spin(SEND_SECONDS)
            self.spin(DELIVERY)
        self.silence()
        return sent

    def _recover(self, fault: Fault) -> dict[str, Any]:
        """Wait until the graph goes on; returns how long that took."""
        healed, told, turn = time.monotonic(), len(self.acknowledged), self.turn
        if fault.node == "recorder" and fault.kind == "stop":
            self.wait("the recorder to catch up", lambda: self._recorded() >= turn)
        elif fault.node == "recorder":
            self.wait("a new recording", lambda: "recorder" in self.recordings)
            self._has_strangers = False
        self._walk(NEW_TICKS)
        self.wait("new transitions", lambda: len(self.acknowledged) > told)
        found = {"refused": self._refused()} if fault.kind == "messages" else {}
        return {**found, "seconds_to_recover": round(time.monotonic() - healed, 2)}

    def _recorded(self) -> Turn:
        """Episode and tick of the newest state that the recorder says it has."""
        said = self.said.get("recorder")
        turns = [value.value.split(" ") for value in said.values if value.key == "episode, tick"] if said else []
        return (int(turns[-1][0]), int(turns[-1][1])) if turns else (0, -1)

    def _check_disk(self) -> dict[str, Any]:
        """The trainer is away: is everything on disk that it told?"""
        return check_transitions(self.acknowledged, self.training)

    def _check_recording(self, fault: Fault, end: float) -> dict[str, Any]:
        """A recorder was there until `end`: is all in its recording, and rightly read?"""
        path, since = self.recordings.pop(fault.node)
        is_cut = fault.kind != "terminate"
        before = end - RECORDING_END * is_cut
        wanted = [turn for turn, at in self.heard["state"].items() if since <= at < before and turn not in self._halved]
        has_strangers = self._has_strangers and fault.node != SECOND
        ended = {n: message.outcome for n, (message, at) in self.ended.items() if since <= at < before}
        seen = frozenset(self.heard["state"])
        answered = self.answered(since, before) - self._halved
        said = None if has_strangers else MonitorRecord(answered, seen, ended, is_cut, self._halved)
        return {**check_recording(path, wanted, said), "strangers": has_strangers}
