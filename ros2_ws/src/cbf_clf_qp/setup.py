"""Installs cbf_clf_qp as setup.cfg says."""

from setuptools import setup

setup()
