"""Installs rabbit_description: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_description"

setup(
    name=NAME,
    version="0.1.0",
    description="What the RABBIT robot is, as data: URDF, state layout, gait files",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "urdf/*.urdf", "gaits/*.yaml", "gait_libraries/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/urdf", sorted(map(str, Path().glob(f"{NAME}/urdf/*.urdf")))),
        (f"share/{NAME}/gaits", sorted(map(str, Path().glob(f"{NAME}/gaits/*.yaml")))),
        (f"share/{NAME}/gait_libraries", sorted(map(str, Path().glob(f"{NAME}/gait_libraries/*.yaml")))),
    ],
    install_requires=[
        "numpy",
        "pydantic>=2",
        "pyyaml",
    ],
    extras_require={"test": ["pytest"]},
)
