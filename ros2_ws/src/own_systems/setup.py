"""Installs own_systems as setup.cfg says. pip finds the other packages in the folders beside this one."""

from pathlib import Path

from setuptools import setup

LIBRARIES = ["casadi", "matplotlib", "numpy>=2", "pydantic>=2", "rich", "rosbags>=0.11.9,<0.12", "typer"]
PACKAGES = [
    "cbf_clf_qp",
    "rabbit_description",
    "rabbit_common",
    "rabbit_sim",
    "rl_cbf_clf_controller",
    "rl_trainer",
    "rabbit_recording",
    "rabbit_experiments",
    "rabbit_viewer",
]
BESIDE = Path(__file__).resolve().parents[1]

# where the packages lie; colcon reads no address without a host
places = {each: f" @ file://localhost{BESIDE / each}" for each in PACKAGES if (BESIDE / each).is_dir()}
setup(python_requires=">=3.11", install_requires=LIBRARIES + [each + places.get(each, "") for each in PACKAGES])
