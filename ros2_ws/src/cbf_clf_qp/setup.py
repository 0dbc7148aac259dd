"""Installs cbf_clf_qp, as setup.cfg says: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from setuptools import setup

setup()
