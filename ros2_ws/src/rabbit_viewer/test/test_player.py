"""A played walk is as repeatable as any other, whatever is asked of it and however badly."""

import json
import random
import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from played import Played
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.play.messages import Asked
from rabbit_viewer.play.player import Player
from rabbit_viewer.play.serving import Door, check_walk
from rabbit_viewer.play.settings import PlaySettings, Start
from rl_cbf_clf_controller.parameters import ControllerParameters

BASE = SimulationParameters(stop_at_miss=False)
USUAL = {"first": "learned", "second": "none", "stones": 3, "seed": 1, "mass_scale": 2.0}
BAD_MESSAGES = 5_000


def start_of(**changes: Any) -> Start:
    """What is played, one robot unless `changes` name a second."""
    settings = PlaySettings.model_validate({**USUAL, **changes})
    return Start(settings=settings, plant=BASE, controller=ControllerParameters())


@pytest.fixture
def played() -> Iterator[Callable[..., Played]]:
    """Makes players, and closes them."""
    made: list[Played] = []

    def make(**changes: Any) -> Played:
        made.append(Played(Player, start_of(**changes)))
        return made[-1]

    yield make
    for played in made:
        played.player.close()


def test_one_falls_and_the_other_walks_on(played: Callable[..., Played]) -> None:
    both = played(first="learned", second="nominal", stones=5).go_on()
    (learned, stones), (nominal, fewer) = ((w["outcome"], w["stones"]) for w in both.words["ended"]["walkers"])
    assert (learned, stones) == ("walked", 5)
    assert nominal != "walked"
    assert fewer < 5
    lowest = np.minimum(both.rows(1)["hip_z"], both.rows(1)["head_z"])[-1]
    assert lowest < 0.3  # it is seen to fall to the ground
    assert both.rows(0)["running"][:-1].all()


def test_a_link_is_the_same_walk_with_its_settings(played: Callable[..., Played]) -> None:
    """In a second player, started with other settings, every number of every tick is the same."""
    one = played(second="oracle", stones=6).go_on(30)
    changes = {"mass_scale": 1.7, "payload": 4, "stone_width": 0.2, "velocity_noise": 0.1}
    one.ask("set", settings={**changes, "again": "same course", "first": "nominal"})
    one.ask("reset")
    one.go_on()
    settings = one.words["state"]["settings"]
    two = played(mass_scale=1.0, seed=9).go_on(10)
    two.ask("begin", settings=settings)
    two.go_on()
    assert two.broadcast.known[1] == one.broadcast.known[1]
    assert two.words["state"]["settings"] == settings


def test_why_it_fell_is_the_barrier_that_its_foot_was_beyond(played: Callable[..., Played]) -> None:
    """With three times the mass the first foot lands past the far edge; the named tick's row is in its explanation."""
    one = played(first="tuned", mass_scale=3.0).go_on()
    ended = one.words["ended"]["walkers"][0]
    (landing,) = one.player.walkers[0].records.landings
    off = (landing[2] - landing[4]) * 1000
    assert off > 0
    assert f"{off:.0f} mm past the far edge" in ended["reason"]
    assert "the row B1, “land before the far edge”" in ended["reason"]
    one.ask("explain", walker=0, tick=ended["tick"])
    lines = one.words["explained"]["lines"]
    assert lines[0].startswith(f"robot tuned, tick {ended['tick']} ")
    (row,) = [line.split() for line in lines if re.match("B1 +at least", line)]
    promised, measured, off = row[7:10]
    assert f"promised {promised} m/s², {measured} was measured, {off.lstrip('-')} off" in ended["reason"]


def bad_message(rng: random.Random, good: list[str]) -> str:
    """JSON gone wrong, of any kind."""
    kind = rng.randrange(5)
    text = rng.choice(good)
    if kind == 0:
        return "".join(chr(rng.randrange(1, 0xD800)) for _ in range(rng.randrange(60)))
    if kind == 1:
        return text[: rng.randrange(len(text))]
    values = [None, -1, 1e308, "x" * rng.randrange(200), [], {}, [[[]]], True, float("nan"), -(10**30), "\0"]
    message = json.loads(text)
    where = message
    if kind == 2 and "settings" in message:
        where = message["settings"]
    name = rng.choice([*where, "do", "extra", "__class__", ""])
    where[name] = rng.choice(values)
    return json.dumps(message) if kind < 4 else json.dumps([message] * rng.randrange(1, 4))


GOOD = [
    json.dumps({"do": "set", "settings": PlaySettings().model_dump(mode="json")}),
    json.dumps({"do": "begin", "settings": PlaySettings().model_dump(mode="json")}),
    json.dumps({"do": "push", "force": 100, "seconds": 0.1}),
    json.dumps({"do": "speed", "speed": 1}),
    json.dumps({"do": "pause", "paused": True}),
]


def test_bad_messages_do_no_harm(played: Callable[..., Played]) -> None:
    """Each is refused with a line, or was good after all; a player takes what passes, and walks as if nothing was."""
    rng, one = random.Random(7), played()
    passed: list[Asked] = []

    def ask(asked: Asked) -> str:
        passed.append(asked)
        return ""

    door = Door(partial(check_walk, start_of()), ask)
    refused = 0
    while refused < BAD_MESSAGES:
        count = len(passed)
        line = door(bad_message(rng, GOOD))
        assert "\n" not in line
        assert len(line) <= 300
        assert bool(line) == (len(passed) == count)
        refused += bool(line)
        if refused % 50 == 0 and not one.player.has_ended:
            one.player.tick()
    assert len(passed) < refused / 4
    np.testing.assert_array_equal(one.go_on().rows()["hip_x"], played().go_on().rows()["hip_x"])
    for asked in passed[:200]:
        one.player.take(asked)


def test_what_the_plant_refuses_is_refused_at_the_door() -> None:
    def answer(start: Start, message: str) -> str:
        return Door(partial(check_walk, start), lambda _: "")(message)

    wide = {"do": "set", "settings": {"l_min_std": 0.08, "stone_width": 0.3}}
    far = start_of().model_copy(update={"plant": BASE.model_copy(update={"l_min_mean": 0.5})})
    assert "expected at most 0.9 m" in answer(far, json.dumps(wide))
    push = '{"do": "push", "force": 10}'
    rigid = start_of().model_copy(update={"plant": BASE.model_copy(update={"plant": "rigid"})})
    assert "expected the plant pybullet or mujoco" in answer(rigid, push)
    begun = json.dumps({"do": "begin", "settings": {"coulomb": 5.0}})
    assert "coulomb = 5 with plant rigid: expected 0, pybullet or mujoco" in answer(rigid, begun)
    assert not answer(start_of(), begun)
    assert not answer(start_of(), push)
