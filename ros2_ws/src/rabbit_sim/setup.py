"""Installs rabbit_sim: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_sim"
HERE = Path(__file__).resolve().parent


def sibling(name: str) -> str:
    """A package beside this one, required by its path, since no registry has it."""
    return f"{name} @ {(HERE.parent / name).as_uri()}"


setup(
    name=NAME,
    version="0.1.0",
    description="The true plant in PyBullet or with a pinned foot, stones, perturbations; node: the simulator",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "**/*.yaml", "**/*.urdf", "**/*.json", "**/*.safetensors"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(map(str, Path().glob(f"{NAME}/config/*.yaml")))),
    ],
    install_requires=[
        sibling("rabbit_description"),
        "numpy>=2",
        "scipy",
        "pin>=4.1,<5",
        "pybullet>=3.2.7",
        "pydantic>=2",
        "pyyaml",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={"console_scripts": ["simulator = rabbit_sim.node:main"]},
)
