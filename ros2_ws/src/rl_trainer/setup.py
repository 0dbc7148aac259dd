"""Installs rl_trainer as setup.cfg says."""

from setuptools import setup

setup()
