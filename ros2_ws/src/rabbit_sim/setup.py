"""Installs rabbit_sim: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_sim"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="The true plant in PyBullet or with a pinned foot, stones, perturbations; node: the simulator",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"lib/{NAME}", sorted(map(str, Path().glob("bin/*")))),
    ],
    install_requires=[
        f"rabbit_description @ {BESIDE}/rabbit_description",
        "numpy>=2",
        "scipy",
        "pin>=4.1,<5",
        "pybullet>=3.2.7",
        "pydantic>=2",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "rabbit.plants": [
            "pybullet = rabbit_sim.pybullet_plant:PybulletPlant",
            "rigid = rabbit_sim.rigid_plant:RigidPlant",
        ],
        "rabbit.nodes": ["simulator = rabbit_sim.ros.node:main"],
    },
)
