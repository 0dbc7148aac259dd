"""Plain colcon in the workspace: which packages it takes, and that `colcon test` runs their tests."""

import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
PACKAGES = {path.parent.name for path in WORKSPACE.glob("src/*/package.xml")}
TESTED = PACKAGES - {"rabbit_msgs"}  # it has messages alone
SHORT = " or ".join(  # a file of each, since `make test-all` runs the rest
    ("test_estimates", "urdf", "conversions", "exit_codes", "impact", "previews", "reward", "symbolic", "counting")
    + ("geometry", "intervals", "leg_kinematics", "commands", "play_settings", "gaussian_process")
)


def colcon(*arguments: str, logs: Path) -> subprocess.CompletedProcess[str]:
    """Call colcon in the workspace."""
    command = [sys.executable, shutil.which("colcon") or "colcon", "--log-base", str(logs), *arguments]
    return subprocess.run(command, cwd=WORKSPACE, capture_output=True, text=True, timeout=300)


def colcon_test(folder: Path, *arguments: str) -> int:
    """The exit code of `colcon test`; the results lie in the folder."""
    results = ["--test-result-base", str(folder), "--return-code-on-test-failure", "--executor", "sequential"]
    return colcon("test", *results, *arguments, logs=folder / "log").returncode


def test_plain_colcon_takes_the_projects_packages_alone(tmp_path: Path) -> None:
    assert set(colcon("list", "--names-only", logs=tmp_path).stdout.split()) == PACKAGES


def test_colcon_test_runs_every_packages_tests(tmp_path: Path) -> None:
    assert colcon_test(tmp_path, "--packages-select", *TESTED, "--pytest-args", f" -k {SHORT}") == 0
    reports = {package: ElementTree.parse(tmp_path / package / "pytest.xml") for package in TESTED}
    ran = {package: len(list(report.iter("testcase"))) for package, report in reports.items()}
    assert min(ran.values()) > 0, ran
    counted = colcon("test-result", "--all", "--test-result-base", str(tmp_path), logs=tmp_path / "log").stdout
    assert f"Summary: {sum(ran.values())} tests, 0 errors, 0 failures" in counted


def test_colcon_test_fails_where_nothing_ran(tmp_path: Path) -> None:
    assert colcon_test(tmp_path, "--packages-select", "rabbit_description", "--pytest-args", " -k no_such_test") != 0
