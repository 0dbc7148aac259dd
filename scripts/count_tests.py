"""Fail if a group of tests did not run: a suite in which all ROS tests were skipped is not a green one.

Reads pytest's JUnit file, given as the argument. A folder of tests/ is a group, and so are the tests of each package.
"""

import sys
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

OWN_TARGET = {"browser"}  # `make test-browser`, where there is a browser


def group_of(test_class: str) -> str:
    """`ros` of `tests.ros.test_graph`, `rabbit_sim` of `ros2_ws.src.rabbit_sim.test.test_stones`."""
    return test_class.removeprefix("ros2_ws.src.").removeprefix("tests.").split(".")[0]


def ran(report: Path) -> Counter[str]:
    """How many tests of each group ran, of those that were chosen; pytest itself reports failures."""
    counts: Counter[str] = Counter()
    for case in ElementTree.parse(report).iter("testcase"):
        group = group_of(case.get("classname", "") or case.get("name", ""))  # a file that is skipped has its name there
        counts[group] += not len(case) or case[0].tag == "properties"
    return counts


def main(report: Path) -> None:
    """Print the counts; exit 1 if one of them is zero."""
    counts = ran(report)
    print("tests run: " + ", ".join(f"{group} {counts[group]}" for group in sorted(counts)))
    if missing := sorted(group for group in counts.keys() - OWN_TARGET if not counts[group]):
        sys.exit(f"tests: none of {missing[0]} ran; look there for skips or a missing ROS 2")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
