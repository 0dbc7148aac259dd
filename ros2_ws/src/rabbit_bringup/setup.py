"""Installs rabbit_bringup: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_bringup"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="What brings the graph up: launch files, configuration, the launcher, the rabbit command",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(map(str, Path().glob("launch/*.launch.py")))),
        (f"share/{NAME}/config", sorted(map(str, Path().glob("config/*")))),
        (f"lib/{NAME}", sorted(map(str, Path().glob("bin/*")))),
        ("bin", ["bin/rabbit"]),
    ],
    install_requires=[
        f"rabbit_description @ {BESIDE}/rabbit_description",
        f"rabbit_cli @ {BESIDE}/rabbit_cli",
        f"rabbit_sim @ {BESIDE}/rabbit_sim",
        f"rl_cbf_clf_controller @ {BESIDE}/rl_cbf_clf_controller",
        f"rl_trainer @ {BESIDE}/rl_trainer",
        f"rabbit_recording @ {BESIDE}/rabbit_recording",
        f"rabbit_viewer @ {BESIDE}/rabbit_viewer",
        f"rabbit_experiments @ {BESIDE}/rabbit_experiments",
        "numpy>=2",
        "pydantic>=2",
        "pyyaml",
        "rich",
        "typer",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "rabbit.nodes": ["launcher = rabbit_bringup.ros.launcher:main"],
        "rabbit.commands": ["run = rabbit_bringup.commands.run:app", "walk = rabbit_bringup.commands.walk:app"],
    },
)
