"""Runs sequences of rules for hours: a line of JSON for each batch, which is drawn from its number alone.

source ros2_ws/install/setup.bash
python -m qa.test.ros.stateful --rules 5000 --out DIR      # the same command goes on where it was stopped
python -m qa.test.ros.stateful --batch 12                  # once more, shrunk where it fails
"""

import argparse
import json
import os
import signal
import sys
import time
import traceback
from pathlib import Path
from typing import Any

RESULTS = "sequences.jsonl"
SEQUENCES = 10  # of a batch
LENGTHS = range(5, 31)  # rules of a sequence
FAILED, INTERRUPTED = 1, 130
SHARED = Path(__file__).parents[4] / "tests/shared"  # what pytest has on its path


def main() -> int:
    """Exit code 1 where something was wrong, 130 where interrupted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rules", type=int, default=5000, help="number in all (default: 5000)")
    parser.add_argument("--first", type=int, default=0, help="number of the first batch: for campaigns side by side")
    parser.add_argument("--batch", type=int, help="this one alone")
    parser.add_argument("--out", type=Path, default=Path("runs/sequences"), help="folder of the results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has had Ctrl-C ignored
        signal.signal(number, signal.default_int_handler)
    try:
        if options.batch is not None:
            rows = [run_batch(options.batch, options.out)]
            print(line(rows[0]))
        else:
            rows = campaign(options)
    except KeyboardInterrupt:
        print(f"interrupted; the same command goes on from {options.out}", file=sys.stderr)
        return INTERRUPTED
    return 0 if all(row["passed"] for row in rows) else FAILED


def campaign(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Batches until there are so many rules; returns all that are in the results."""
    path = options.out / RESULTS
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    rows = [json.loads(line) for line in lines if line.endswith("\n")]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    while (done := sum(row["rules"] for row in rows)) < options.rules:
        rows.append(run_batch(options.first + len(rows), options.out))
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        print(f"{line(rows[-1])}; {done + rows[-1]['rules']} of {options.rules} rules", flush=True)
    return rows


def line(row: dict[str, Any]) -> str:
    """What is printed of a batch: after one that failed, what was wrong, and the recipe."""
    text = "{batch}: {sequences} sequences, {rules} rules, {seconds} s".format(**row)
    wrong = "" if row["passed"] else f"{row['wrong']}\nWRONG: "
    return f"{wrong}{time.strftime('%H:%M:%S')} batch {text}"


def run_batch(number: int, out: Path) -> dict[str, Any]:
    """Sequences of one length; the row says what was wrong, and the shortest recipe that was found for it."""
    from hypothesis import HealthCheck, Phase, seed, settings
    from hypothesis.stateful import run_state_machine_as_test
    from rabbit_experiments import provenance

    from .machine import GraphMachine
    from .sequence import Sequence, Shared

    Shared.folder = out
    chosen = settings(
        max_examples=SEQUENCES,
        stateful_step_count=LENGTHS[number % len(LENGTHS)],
        database=None,
        deadline=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
        report_multiple_bugs=False,
    )
    began, sequences, rules, wrong = time.monotonic(), Sequence.sequences_done, Sequence.rules_done, ""
    try:
        run_state_machine_as_test(seed(number)(GraphMachine), settings=chosen)
    except KeyboardInterrupt:
        Shared.drop(keep=False)
        raise
    except Exception as error:
        wrong = "".join(traceback.format_exception(error, limit=-2))
    return {
        "batch": number,
        "passed": not wrong,
        "sequences": Sequence.sequences_done - sequences,
        "rules": Sequence.rules_done - rules,
        "seconds": round(time.monotonic() - began, 1),
        "commit": provenance.commit(),
        "wrong": wrong,
    }


if __name__ == "__main__":
    sys.path.insert(0, str(SHARED))
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    from rabbit_common.ros.network import choose_network

    choose_network()
    sys.exit(main())
