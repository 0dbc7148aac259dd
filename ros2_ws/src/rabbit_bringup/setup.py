"""Installs rabbit_bringup: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_bringup"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="What puts the packages together: launcher, recorder, viewer, experiments, the rabbit command",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "viewing/live/*.json", "reproduce/*.csv"]},
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
        f"rabbit_sim @ {BESIDE}/rabbit_sim",
        f"rl_cbf_clf_controller[gait] @ {BESIDE}/rl_cbf_clf_controller",
        f"rl_trainer @ {BESIDE}/rl_trainer",
        "numpy>=2",
        "scipy",
        "pydantic>=2",
        "pyyaml",
        "typer",
        "rich",
        "joblib",
        "matplotlib",
        "tensorboard",
        "imageio-ffmpeg",
        "rosbags>=0.11.9,<0.12",
        "foxglove-sdk>=0.30.3,<0.31",
        "websockets>=16",
    ],
    extras_require={"test": ["pytest"], "ray": ["ray>=2.40"]},
    entry_points={
        "rabbit.nodes": [
            "launcher = rabbit_bringup.launching.launcher_node:main",
            "recorder = rabbit_bringup.recording.recorder_node:main",
            "viewer = rabbit_bringup.viewing.live.viewer_node:main",
        ],
    },
)
