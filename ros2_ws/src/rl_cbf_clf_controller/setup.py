"""Installs rl_cbf_clf_controller as setup.cfg says."""

from setuptools import setup

setup()
