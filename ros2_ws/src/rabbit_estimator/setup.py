"""Installs rabbit_estimator as setup.cfg says."""

from setuptools import setup

setup()
