"""Fail if a group of tests did not run: a suite in which all ROS tests were skipped is not a green one.

Reads pytest's JUnit file, given as the argument; behind it, groups that were left out. A folder of tests/ is a group,
and so are the tests of each package.
"""

import sys
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
OWN_TARGET = {"browser"}  # `make test-browser`, where there is a browser


def group_of(test_class: str) -> str:
    """`ros` of `tests.ros.test_graph`, `rabbit_sim` of `ros2_ws.src.rabbit_sim.test.test_stones`."""
    return test_class.removeprefix("ros2_ws.src.").removeprefix("tests.").split(".")[0]


def ran(report: Path) -> Counter[str]:
    """How many tests of each group ran; pytest itself reports failures."""
    cases = ElementTree.parse(report).iter("testcase")
    return Counter(
        group_of(case.get("classname", "")) for case in cases if not len(case) or case[0].tag == "properties"
    )


def main(report: Path, *left_out: str) -> None:
    """Print the counts; exit 1 if one of them is zero."""
    counts = ran(report)
    files = [
        *ROOT.glob("tests/*/test_*.py"),
        *ROOT.glob("ros2_ws/src/*/test/test_*.py"),
        *ROOT.glob("[sq]*/test/test_*.py"),
    ]
    groups = sorted({group_of(".".join(file.relative_to(ROOT).parts)) for file in files} - OWN_TARGET - {*left_out})
    print("tests run: " + ", ".join(f"{group} {counts[group]}" for group in groups))
    if missing := [group for group in groups if not counts[group]]:
        sys.exit(f"tests: none of {missing[0]} ran; look there for skips or a missing ROS 2")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
