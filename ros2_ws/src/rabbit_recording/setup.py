"""Installs rabbit_recording as setup.cfg says."""

from setuptools import setup

setup()
