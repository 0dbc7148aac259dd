"""Installs rabbit_bringup: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_bringup"
HERE = Path(__file__).resolve().parent


def sibling(name: str) -> str:
    """A package beside this one, required by its path, since no registry has it."""
    return f"{name} @ {(HERE.parent / name).as_uri()}"


setup(
    name=NAME,
    version="0.1.0",
    description="What puts the packages together: launcher, recorder, viewer, experiments, the rabbit command",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "**/*.yaml", "**/*.urdf", "**/*.json", "**/*.safetensors"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(map(str, Path().glob("launch/*.launch.py")))),
        (f"share/{NAME}/config", sorted(map(str, Path().glob("config/*")))),
        (f"lib/{NAME}", sorted(map(str, Path().glob("bin/*")))),
    ],
    install_requires=[
        sibling("rabbit_description"),
        sibling("rabbit_sim"),
        sibling("rl_cbf_clf_controller"),
        sibling("rl_trainer"),
        "numpy>=2",
        "scipy",
        "pydantic>=2",
        "pyyaml",
        "typer",
        "rich",
        "tqdm",
        "joblib",
        "matplotlib",
        "imageio",
        "imageio-ffmpeg",
        "pillow",
        "casadi>=3.8",
        "rosbags>=0.11.9,<0.12",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={"console_scripts": ["rabbit = rabbit_bringup.cli:app"]},
)
