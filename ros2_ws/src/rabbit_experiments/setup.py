"""Installs rabbit_experiments as setup.cfg says."""

from setuptools import setup

setup()
