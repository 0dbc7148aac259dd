"""Installs rabbit_sim as setup.cfg says."""

from setuptools import setup

setup()
