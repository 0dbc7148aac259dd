"""Fail if a kind of test did not run: a suite in which all ROS tests were skipped is not a green one.

Reads pytest's JUnit file, given as the argument; the kinds are the folders of tests/.
"""

import sys
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

KINDS = ("unit", "properties", "closed_loop", "ros")


def ran(report: Path) -> Counter[str]:
    """How many tests of each kind ran; pytest itself has told of failures."""
    cases = ElementTree.parse(report).iter("testcase")
    return Counter(
        case.get("classname", "").split(".")[1] for case in cases if not len(case) or case[0].tag == "properties"
    )


def main(report: Path) -> None:
    """Print the counts; exit 1 if one of them is zero."""
    counts = ran(report)
    print("tests run: " + ", ".join(f"{kind} {counts[kind]}" for kind in KINDS))
    missing = [kind for kind in KINDS if not counts[kind]]
    if missing:
        sys.exit(f"tests: none ran in tests/{missing[0]}; look there for skips or a missing ROS 2")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
