"""An option's help, default and exit code; who can hear a process's nodes, by what the environment says."""

import os

import pytest
from pydantic import BaseModel, Field
from rabbit_common.exit_codes import ExitCode, of_walk
from rabbit_common.options import Defaults, Given, described
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


@pytest.mark.parametrize(
    ("outcomes", "code"),
    [
        (["walked"], ExitCode.WALKED),
        (["walked", "fall", "walked"], ExitCode.FELL),
        (["silent", "fall", "walked"], ExitCode.FAULT),
        (["reset", "walked"], ExitCode.WALKED),  # an operator asked for the second
        (["reset", "miss"], ExitCode.FELL),
        (["walked", "reset"], ExitCode.FAULT),  # nothing followed it
        ([], ExitCode.FAULT),
    ],
)
def test_the_worst_episode_counts(outcomes: list[str], code: ExitCode) -> None:
    assert of_walk(outcomes) is code


class Robot(BaseModel):
    """What a command has defaults of its own for."""

    controller: str = Field("nominal", description="which")
    lag: float = Field(0.0, description="s")
    scale: float = Field(1.0, description="of the mass")


OWN = Defaults(always={"lag": 0.004}, bare={"controller": "learned", "scale": 2.0})


def test_a_commands_own_defaults_are_those_that_its_help_names_and_count_beneath_what_is_given() -> None:
    assert described([Robot], OWN) == {
        "controller": "which (default: learned)",
        "lag": "s (default: 0.004)",
        "scale": "of the mass (default: 2.0; 1.0 with --controller or --parameters)",
    }
    assert Given({}, OWN).build(Robot) == Robot(controller="learned", lag=0.004, scale=2.0)
    assert Given({"controller": "other"}, OWN).build(Robot) == Robot(controller="other", lag=0.004, scale=1.0)
    assert Given({"lag": "0", "scale": "3"}, OWN).build(Robot) == Robot(controller="learned", lag=0.0, scale=3.0)
    given = Given({"scale": "3"}, OWN).over({"controller": "other", "scale": 4.0})  # what a file says
    assert given.build(Robot) == Robot(controller="other", lag=0.004, scale=3.0)


def test_what_was_typed_can_be_typed_again() -> None:
    given = Given({"scale": "3", "lag": "0.1", "browser": False, "learn": True, "course": "my stones.csv"})
    assert given.typed(but=("scale",)) == "--no-browser --course 'my stones.csv' --lag 0.1 --learn"


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
