"""Installs rabbit_description as setup.cfg says. pip finds the other packages in the folders beside this one."""

from pathlib import Path

from setuptools import setup

LIBRARIES = ["casadi>=3.7", "numpy", "pydantic>=2", "pyyaml", "scipy"]
PACKAGES = ["cbf_clf_qp"]
BESIDE = Path(__file__).resolve().parents[1]

# where the packages lie; colcon reads no address without a host
places = {each: f" @ file://localhost{BESIDE / each}" for each in PACKAGES if (BESIDE / each).is_dir()}
setup(python_requires=">=3.11", install_requires=LIBRARIES + [each + places.get(each, "") for each in PACKAGES])
