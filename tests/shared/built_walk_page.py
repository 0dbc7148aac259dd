"""The page where the robot walks in the browser, built for a test where the tools for it are."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import browser_tools


def build(site: Path) -> Path:
    """Build it in a folder; skips the test where node, npm or what `make docs` installs is missing."""
    if why := browser_tools.missing():
        pytest.skip(f"the page cannot be built here: {why}")
    from rabbit_in_browser.build import build_page

    build_page(site, **browser_tools.TOOLS)
    return site
