"""Installs rabbit_common as setup.cfg says."""

from setuptools import setup

setup()
