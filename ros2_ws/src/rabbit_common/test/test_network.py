"""Who can hear a process's nodes, by what the environment says."""

import os

import pytest
from rabbit_common.ros.network import (
    FAST_DDS,
    MIDDLEWARE,
    PEERS,
    PROFILE,
    PROFILES,
    RANGE,
    WHOLE,
    StartError,
    choose_network,
    domain,
)

NAMES = (RANGE, PEERS, PROFILE, WHOLE, MIDDLEWARE)
ALONE, NETWORK = str(PROFILES / "fastdds.xml"), str(PROFILES / "fastdds_network.xml")


@pytest.mark.parametrize(
    ("given", "chosen"),
    [
        ({}, {PROFILE: ALONE, WHOLE: "1", RANGE: "SYSTEM_DEFAULT"}),
        ({RANGE: "LOCALHOST"}, {PROFILE: ALONE, WHOLE: "1", RANGE: "SYSTEM_DEFAULT"}),
        ({RANGE: "SUBNET"}, {PROFILE: NETWORK, WHOLE: "1", RANGE: "SUBNET"}),
        ({RANGE: "OFF"}, {PROFILE: NETWORK, WHOLE: "1", RANGE: "OFF"}),
        ({PEERS: "10.0.0.7"}, {PROFILE: NETWORK, WHOLE: "1", RANGE: "LOCALHOST", PEERS: "10.0.0.7"}),
        ({PROFILE: "/my.xml"}, {PROFILE: "/my.xml"}),
        ({MIDDLEWARE: "rmw_cyclonedds_cpp"}, {MIDDLEWARE: "rmw_cyclonedds_cpp", RANGE: "LOCALHOST"}),
        ({MIDDLEWARE: FAST_DDS}, {MIDDLEWARE: FAST_DDS, PROFILE: ALONE, WHOLE: "1", RANGE: "SYSTEM_DEFAULT"}),
    ],
)
def test_the_environment_decides(
    given: dict[str, str], chosen: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    for _ in range(2):  # a second call, or a child's, changes nothing
        choose_network()
        assert {name: os.environ[name] for name in NAMES if name in os.environ} == chosen
    for name in NAMES:
        os.environ.pop(name, None)  # what was not there before, monkeypatch would leave


@pytest.mark.parametrize("value", ["abc", "-1", "233", "1.5", "0x10", "٣"])
def test_a_domain_that_is_none_is_refused(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", value)
    with pytest.raises(StartError, match=f"ROS_DOMAIN_ID {value}: expected a whole number from 0 to 232"):
        domain()
