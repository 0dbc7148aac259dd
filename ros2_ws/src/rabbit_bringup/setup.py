"""Installs rabbit_bringup as setup.cfg says."""

from setuptools import setup

setup()
