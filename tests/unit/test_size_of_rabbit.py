"""RABBIT's 7 coordinates, 4 joints and their names stand in a few files of the robot itself; all else asks them."""

import io
import re
import tokenize
from pathlib import Path

SOURCES = Path(__file__).parents[2] / "ros2_ws/src"
JOINT = re.compile(r"(left|right)_(hip|knee)\b|(left|right)_(hip|knee)_")

OF_THE_ROBOT = {
    "rabbit_description/state.py": "where they are said",
    "rl_cbf_clf_controller/planar_robot.py": "the tree of its links: the feet are on links 2 and 4",
    "rabbit_sim/kinematics.py": "where its feet are, joint by joint",
    "perturbations/links.py": "joints of its URDF at which a link is bent or longer",
    "perturbations/motors.py": "an option for each motor's gain",
    "page/rows.py": "points of its body that the page draws",
}
INNOCENT = {  # a 7 or a 4 that is none of the robot's: file, line, and what it is
    "cbf_clf_qp/affine.py": {"if n <= 4": "up to which size a matrix is inverted by minors"},
    "contact_aided_filter.py": {"4 * p.accelerometer_noise": "(2 sigma)^2", "dt**4 / 12": "of an integral"},
    "c_example/__init__.py": {"NOISES = 4": "of a tick's sensors"},
    "commands/system.py": {"DECIMALS = 4": "digits"},
    "own_systems/pictures.py": {"markersize=4": "points"},
    "rl_trainer/ros/task_trainer.py": {"Field(4": "episodes"},
    "launch/walk.launch.py": {"4 * PATIENCE": "seconds"},
    "rabbit_common/exit_codes.py": {"NODE_DIED = 4": "an exit code"},
    "rabbit_experiments/metrics.py": {"round(seconds, 7)": "digits"},
    "former_messages.py": {"bytes(4)": "bytes"},
    "message_header.py": {"// 4 * 4": "bytes", "data[4:16]": "bytes"},
    "rigid_plant.py": {"h**2 / 4": "of Runge and Kutta"},
    "pybullet_plant.py": {"point[7]": "a field of PyBullet's contact"},
    "rabbit_viewer/filmstrip.py": {"markersize=4": "points"},
    "page/rows.py": {'"pushed": 4': "a bit"},
    "play/messages.py": {"le=4": "times as fast"},
    "rabbit_viewer/scene.py": {"linewidth": "points", "markersize": "points"},
    "rabbit_viewer/style.py": {"font.size": "points", "columns: int = 4": "of a legend"},
    "ros/policies.py": {"WAITING = 4": "policies"},
}


def lines_of(path: Path) -> list[str]:
    """Those with a 7 or a 4, or with a joint's name."""
    text = path.read_text()
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    rows = {
        token.start[0]
        for token in tokens
        if (token.type == tokenize.NUMBER and token.string in ("7", "4"))
        or (token.type != tokenize.COMMENT and JOINT.search(token.string))
    }
    return [text.splitlines()[row - 1] for row in sorted(rows)]


def entry(table: dict, path: Path):
    return next((found for name, found in table.items() if path.as_posix().endswith(name)), None)


def test_only_files_of_the_robot_hold_its_size_or_its_joints_names():
    product = [path for path in SOURCES.glob("*/**/*.py") if "test" not in path.relative_to(SOURCES).parts]
    held = {path: lines_of(path) for path in product}
    assert len(product) > 250
    for path, lines in held.items():
        innocent = entry(INNOCENT, path) or {}
        for words in innocent:
            assert any(words in line for line in lines), f"{path}: {words} is no longer there"
        others = [line for line in lines if not any(words in line for words in innocent)]
        assert bool(others) == bool(entry(OF_THE_ROBOT, path)), f"{path}: {others}"
    assert len(OF_THE_ROBOT) <= 12
