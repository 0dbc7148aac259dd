"""Installs rabbit_recording: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_recording"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="Recordings: written, read, checked, replayed, recovered; node: the recorder",
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
        f"rabbit_cli @ {BESIDE}/rabbit_cli",
        f"rabbit_sim @ {BESIDE}/rabbit_sim",
        f"rl_cbf_clf_controller @ {BESIDE}/rl_cbf_clf_controller",
        f"rl_trainer @ {BESIDE}/rl_trainer",
        "numpy>=2",
        "pydantic>=2",
        "pyyaml",
        "rich",
        "rosbags>=0.11.9,<0.12",
        "typer",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "rabbit.nodes": ["recorder = rabbit_recording.ros.recorder:main"],
        "rabbit.commands": ["bag = rabbit_recording.commands.bag:app"],
    },
)
