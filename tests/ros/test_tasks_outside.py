"""The tasks of the examples as a user's package outside the project, by pip and by colcon; nothing is edited here."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from rabbit_common.executables import find_executable

ROOT = Path(__file__).resolve().parents[2]
TASKS = ("cart_pole", "segway", "obstacle_arm")
SETUP = """
from setuptools import setup
INDEX = ("share/ament_index/resource_index/packages", ["resource/my_tasks"])
setup(
    name="my_tasks", version="1.0", packages=["my_tasks"], data_files=[INDEX, ("share/my_tasks", ["package.xml"])],
    entry_points={{"rabbit.systems": [{entries}]}},
)
"""
PACKAGE_XML = """<package format="3">
<name>my_tasks</name><version>1.0.0</version><description>Tasks of mine</description>
<maintainer email="me@example.com">me</maintainer><license>MIT</license><exec_depend>rabbit_experiments</exec_depend>
<export><build_type>ament_python</build_type></export></package>"""
GRAPH = """
source {install}/local_setup.bash
rabbit evaluate --task mine_segway --rides 1
{controller} --ros-args -r __ns:=/outside -p task:=mine_cart_pole -p policy:=oracle & controller=$!
{simulator} --ros-args -r __ns:=/outside -p task:=mine_cart_pole -p episodes:=1 > said 2>&1 & simulator=$!
for _ in {{1..600}}; do grep -q "episode 1 ends, done" said && break; sleep 0.2; done
kill $controller $simulator
wait $controller $simulator
grep "episode 1 ends, done" said
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Its folder; the tasks are called `mine_cart_pole` and so on."""
    folder = tmp_path / "src" / "my_tasks"
    (folder / "my_tasks").mkdir(parents=True)
    (folder / "resource").mkdir()
    (folder / "resource" / "my_tasks").touch()
    (folder / "my_tasks" / "__init__.py").touch()
    for task in TASKS:
        shutil.copy(ROOT / "examples" / f"{task}.py", folder / "my_tasks")
    entries = ", ".join(f'"mine_{task} = my_tasks.{task}:TASK"' for task in TASKS)
    (folder / "setup.py").write_text(SETUP.format(entries=entries))
    (folder / "package.xml").write_text(PACKAGE_XML)
    return folder


def run(words: list[str], folder: Path, **more: str) -> str:
    """What a command prints; it must end well."""
    done = subprocess.run(
        words, cwd=folder, env={**os.environ, **more}, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.thorough
def test_built_by_colcon_the_nodes_run_it(package: Path, tmp_path: Path) -> None:
    run([sys.executable, shutil.which("colcon") or "colcon", "build"], tmp_path)
    said = run(
        [
            "bash",
            "-c",
            GRAPH.format(
                install=tmp_path / "install",
                controller=find_executable("rl_cbf_clf_controller", "controller"),
                simulator=find_executable("rabbit_sim", "simulator"),
            ),
        ],
        tmp_path,
    )
    assert "oracle" in said
    assert "episode 1 ends, done" in said
