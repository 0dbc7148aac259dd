"""The URDF against the paper's robot."""

from xml.etree import ElementTree

import pytest
from rabbit_description import URDF_PATH


def test_the_links_weigh_32_kg() -> None:
    masses = [float(mass.attrib["value"]) for mass in ElementTree.parse(URDF_PATH).iter("mass")]
    assert sum(masses) == pytest.approx(32)
