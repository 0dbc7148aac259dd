"""A campaign: fault after fault into a walking graph, a line of JSON for each, until there are so many.

A graph lives for `SESSION` faults, or until something is wrong; then the next one begins. What must hold after a fault:

    the graph goes on: new ticks; new transitions after a trainer's fault, a new recording after a recorder's, which
    catches up where it was stopped
    every transition that the trainer told is on disk
    a recording holds every tick that was told more than a second before its end, also one that began in the middle of
    an episode, and is read as what was heard (`reading`)
"""

import json
import random
import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rabbit_cli.executables import LaunchError

from rabbit_campaigns.faults.checks import check_recording, check_transitions
from rabbit_campaigns.faults.graph import SECOND_NODE, TRAINING, Graph, Hang
from rabbit_campaigns.faults.plan import SECOND, Fault, draw
from rabbit_campaigns.faults.recording_checks import MonitorRecord

RESULTS = "faults.jsonl"
SESSION = 40  # faults
WRONG = ("lost", "missing", "misread")  # what of a row must be nothing
RECORDING_END = 1.0  # s of which a killed recorder may lose all
NEW_TICKS = 3  # after which a graph has recovered
DELIVERY = 0.3  # s in which the witness hears what was told before a node ended


def read_results(out: Path) -> list[dict[str, Any]]:
    """What was done already; a line that a killed campaign has cut is left out."""
    path = out / RESULTS
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    return [json.loads(line) for line in lines if line.endswith("\n")]


def run_campaign(
    out: Path, runs: int, seed: int, hang_after: float, show: Callable[[dict[str, Any]], None]
) -> list[dict[str, Any]]:
    """Inject faults until there are `runs` lines in OUT/faults.jsonl; returns all of them.

    Raises:
        LaunchError: the nodes cannot be started, or do not begin to walk.
    """
    out.mkdir(parents=True, exist_ok=True)
    rows = read_results(out)
    (out / RESULTS).write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    session = 1 + max((int(path.name.split("-")[1]) for path in out.glob("session-*")), default=0)
    while len(rows) < runs:
        new = run_session(out, session, draws(seed, len(rows), min(len(rows) + SESSION, runs)), hang_after, show)
        rows += new
        session += 1
    return rows


def draws(seed: int, first: int, last: int) -> list[Fault]:
    """Faults `first` to `last` of a campaign."""
    return [draw(seed, number) for number in range(first, last)]


def run_session(
    out: Path, number: int, faults: list[Fault], hang_after: float, show: Callable[[dict[str, Any]], None]
) -> list[dict[str, Any]]:
    """One graph and its faults; it ends early where something was wrong."""
    graph = Graph(out / f"session-{number:03d}", f"faults_{time.time_ns()}", number, hang_after)
    rows: list[dict[str, Any]] = []
    try:
        begin(graph)
        session = Session(graph)
        for fault in faults:
            row = {"session": number, **session.inject(fault)}
            rows.append(row)
            with (out / RESULTS).open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            show(row)
            if not row["passed"]:
                break
    finally:
        graph.close()
    if rows and rows[-1]["passed"]:
        shutil.rmtree(graph.folder)  # of interest only where something was wrong
    return rows


def begin(graph: Graph) -> None:
    """Wait until it walks and learns."""
    try:
        graph.wait("the first ticks and transitions", lambda: len(graph.witness.acknowledged) > 1)
        graph.wait("the first recording", lambda: graph.recording() is not None)
    except Hang as error:
        raise LaunchError(str(error)) from error


class Session:
    """Injects faults into one graph and looks at what comes of them."""

    def __init__(self, graph: Graph) -> None:
        self._graph, self._witness = graph, graph.witness
        self._since = self._second_since = time.monotonic()  # when the present recording began, and the second one
        self._has_strangers = False  # in the present recording: messages of nobody's, which say what they like

    def inject(self, fault: Fault) -> dict[str, Any]:
        """One fault; its row says whether all held."""
        about = {"number": fault.number, "kind": fault.kind, "node": fault.node, "seconds": round(fault.seconds, 3)}
        row: dict[str, Any] = {**about, "passed": False, "hang": False, "lost": 0, "error": ""}
        try:
            if fault.node == SECOND:
                self._begin_second()
            target = self._witness.count + fault.after_ticks
            self._graph.wait(f"{fault.after_ticks} ticks", lambda: self._witness.count >= target)
            turn = self._witness.newest
            row["turn"] = list(turn)
            began = time.monotonic()
            row |= self._do(fault)
            row |= self._recover(fault)
            row["whole_seconds"] = round(time.monotonic() - began, 2)
            ended = self._witness.ended.get(turn[0])
            row["episode"] = f"{ended.outcome}: {ended.reason}".strip(": ") if ended else "goes on"
            row["told"] = sorted({text for text in self._witness.warned(began) if "waiting for" in text})[:4]
            row["passed"] = row.get("readable", True) and not any(row.get(name) for name in WRONG)
        except Hang as error:
            row |= {"hang": True, "error": str(error), "told": self._witness.warned(time.monotonic() - 5.0)[-4:]}
        except LaunchError as error:
            row["error"] = f"ended by itself: {error}"
        row["acknowledged"] = len(self._witness.acknowledged)
        return row

    def _begin_second(self) -> None:
        """A second recorder comes, in the middle of an episode."""
        self._witness.said.pop(SECOND_NODE, None)
        self._graph.start(SECOND)
        self._graph.wait("the second recorder", lambda: self._message(SECOND_NODE) == "recording")
        self._second_since = time.monotonic()

    def _do(self, fault: Fault) -> dict[str, Any]:
        """The fault itself; returns what was checked while its node was away."""
        graph, name = self._graph, fault.node
        if fault.kind == "messages":
            rng = random.Random(fault.number)
            before, self._has_strangers = self._witness.refused(), True
            sent = self._witness.disturb(rng, name, fault.seconds)
            self._witness.silence()
            return {"sent": sent, "refused_before": before}
        if fault.kind == "stop":
            graph.hold(name)
            time.sleep(max(fault.seconds, DELIVERY))
            found = self._check_disk() if name == "trainer" else {}
            graph.let_go(name)
            return found
        end = time.monotonic()
        if fault.kind == "terminate":
            graph.terminate(name)
        else:
            if fault.kind == "full disk":
                self._fill(name)
            graph.kill(name)
        self._witness.said.pop(name, None)
        return self._while_away(fault, end)

    def _while_away(self, fault: Fault, end: float) -> dict[str, Any]:
        """Look at what a node has left that ended at a moment, then start it again."""
        if fault.node == SECOND:
            time.sleep(DELIVERY)
            return self._check_recording(fault, self._second_since, end)
        time.sleep(max(fault.seconds, DELIVERY))
        found: dict[str, Any] = {}
        if fault.node == "trainer":
            found = self._check_disk()
        elif fault.node == "recorder":
            found = self._check_recording(fault, self._since, end)
        self._graph.start(fault.node)
        return found

    def _fill(self, name: str) -> None:
        """The node must say so, and the walk go on."""
        self._graph.fill_disk(name)
        words = {"recorder": "recording stopped", "trainer": "not kept any more"}[name]
        self._graph.wait(f"the {name} says that {words}", lambda: words in self._message(name))
        target = self._witness.count + 10
        self._graph.wait("ticks under a full disk", lambda: self._witness.count >= target)

    def _recover(self, fault: Fault) -> dict[str, Any]:
        """Wait until the graph goes on; returns how long that took."""
        witness, healed = self._witness, time.monotonic()
        ticks, told = witness.count + NEW_TICKS, len(witness.acknowledged)
        found: dict[str, Any] = {}
        if fault.node == "recorder" and fault.kind == "stop":
            turn = witness.newest
            self._graph.wait("the recorder to catch up", lambda: self._graph.recorded() >= turn)
        elif fault.node == "recorder":
            newest = partial(self._graph.newest_recording, fault.node)
            self._graph.wait("a new recording", lambda: self._graph.recording() == newest() and self._records())
            self._since, self._has_strangers = time.monotonic(), False
        self._graph.wait("new ticks", lambda: witness.count >= ticks)
        self._graph.wait("new transitions", lambda: len(witness.acknowledged) > told)
        if fault.kind == "messages":
            found["refused"] = witness.refused()
        return {**found, "seconds_to_recover": round(time.monotonic() - healed, 2)}

    def _records(self) -> bool:
        return self._message("recorder") == "recording"

    def _message(self, name: str) -> str:
        said = self._witness.said.get(name)
        return str(said.message) if said else ""

    def _check_disk(self) -> dict[str, Any]:
        """The trainer is away: is everything on disk that it told?"""
        found = check_transitions(list(self._witness.acknowledged), self._graph.training, TRAINING)
        return {"lost": found.lost, "kept": found.kept, "told_transitions": found.told}

    def _check_recording(self, fault: Fault, since: float, end: float) -> dict[str, Any]:
        """A recorder was there from `since` to `end`: is all in its recording, and rightly read?"""
        path, is_cut = self._graph.newest_recording(fault.node), fault.kind != "terminate"
        before = end - RECORDING_END * is_cut
        wanted = self._witness.heard_before(before, since)
        has_strangers = self._has_strangers and fault.node != SECOND
        found = check_recording(path, wanted, None if has_strangers else self._heard(since, before, is_cut))
        for each in (path, path.with_name(f"{path.name}-recovered")):
            if found.readable and not found.missing and not found.misread and each.exists():
                shutil.rmtree(each)
                each.mkdir()  # its name stays taken
        return {
            "readable": found.readable,
            "recorded_ticks": found.ticks,
            "missing": found.missing,
            "misread": list(found.misread),
            "strangers": has_strangers,
        }

    def _heard(self, since: float, before: float, is_cut: bool) -> MonitorRecord:
        witness = self._witness
        ended = witness.ended_within(since, before)
        return MonitorRecord(witness.answered(since, before), witness.seen, ended, is_cut)
