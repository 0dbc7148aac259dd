"""Installs rabbit_common, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install("numpy", "pydantic>=2", "typer")
