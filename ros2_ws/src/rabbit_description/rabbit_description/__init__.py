"""What the robot is, as data: URDF, state layout, gait files. Nothing here computes."""

from pathlib import Path

DATA = Path(__file__).parent
URDF_PATH = DATA / "urdf" / "rabbit.urdf"
ROS2_CONTROL_PATH = DATA / "urdf" / "ros2_control.xml"
GAITS = DATA / "gaits"
LIBRARIES = DATA / "gait_libraries"
DEFAULT_GAIT = "stones_0350_080"
ABOUT_TASK = "a Python file with a ControlTask, a walker's .yaml, or what an installed package brings, by its name"
FRAMES = {"base_link": "torso", "l_sole": "left_foot", "r_sole": "right_foot"}  # of REP 105 and 120, and where they are
FRAME = """  <link name="{0}"/>
  <joint name="{0}_frame" type="fixed"><parent link="{1}"/><child link="{0}"/></joint>
"""


def robot_description() -> str:
    """The URDF for ROS: with the frames that ROS names and the drives. No physics engine gets to see those."""
    text, drives = URDF_PATH.read_text(encoding="utf-8"), ROS2_CONTROL_PATH.read_text(encoding="utf-8")
    return text.replace("</robot>", "".join(FRAME.format(*frame) for frame in FRAMES.items()) + drives + "</robot>")
