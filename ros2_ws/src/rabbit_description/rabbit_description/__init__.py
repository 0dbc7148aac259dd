"""What the robot is, as data: URDF, state layout, gait files. Nothing here computes."""

from importlib.resources import files
from pathlib import Path

DATA = Path(str(files(__package__)))
URDF_PATH = DATA / "urdf" / "rabbit.urdf"
GAITS = DATA / "gaits"
LIBRARIES = DATA / "gait_libraries"
DEFAULT_GAIT = "stones_0350_080"
