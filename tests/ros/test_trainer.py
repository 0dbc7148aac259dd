"""The trainer through the graph: the same weights as in process, and nothing lost."""

from typing import Any

import pytest
from rabbit_bringup.launching.processes import NodeEnded
from rabbit_common.exit_codes import ExitCode
from rabbit_description.gait import load_gait
from rabbit_msgs.msg import Episode
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy
from rl_trainer.parameters import TrainingParameters
from rl_trainer.session import train
from rl_trainer.training import Provenance, Trainer

PLANT = SimulationParameters(mass_scale=2.0, stones=3)
PARAMETERS = ControllerParameters(controller="rl-cbf-clf-qp")
TRAINING = TrainingParameters(
    seed=4, episodes=3, nominal_episodes=1, hidden1=16, hidden2=16, batch=16, updates_least=20, updates_per_tick=0.0
)


def versions_in_process() -> list[str]:
    """Policies of episodes 2 and 3 and the one after."""
    gait = load_gait(PARAMETERS.gait)
    trainer = Trainer(TRAINING, Provenance(command="trainer node"))

    def make_controller(policy: Policy, sigma: float) -> Controller:
        return Controller(PARAMETERS.model_copy(update={"sigma": sigma}), gait, policy)

    return [trainer.policy_file().version for _ in train(trainer, Simulation(PLANT, gait), make_controller)]


def test_graph_learns_the_same_weights(world: Any) -> None:
    weights, episodes, plans = world.hear("policy"), world.hear("episode"), world.hear("episode_plan")
    transitions, commands = world.hear("transition"), world.hear("torque")
    world.start("simulator", trainer="follow", episodes=3, **PLANT.model_dump())
    world.start("controller", swap_at="episode", **PARAMETERS.model_dump())
    world.start("trainer", **TRAINING.model_dump(mode="json"))
    world.go()
    world.wait(lambda: len(plans) == 4)
    expected = versions_in_process()
    assert [plan.policy_version for plan in plans] == ["zero", *expected]
    assert [message.version for message in weights] == expected
    begun = [e for e in episodes if e.phase == Episode.RUNNING and not e.controller]
    assert [(e.seed, e.sigma) for e in begun] == [(plan.seed, plan.sigma) for plan in plans[:3]]
    by_episode = {number: [c for c in commands if c.episode == number] for number in (1, 2, 3)}
    for plan, mine in zip(plans, by_episode.values(), strict=False):
        assert {command.policy_version for command in mine} == {plan.policy_version}
    ticks = [(t.episode, t.tick) for t in transitions]
    assert ticks == [(n, c.tick) for n, mine in by_episode.items() for c in mine]


@pytest.mark.timeout(1800)
def test_without_a_parameter_the_graph_walks_learns_after_each_episode_and_swaps(root_world: Any) -> None:
    """The three executables as they are. The trainer is there first, so each episode is walked as it plans."""
    world, episodes, plans = root_world, root_world.hear("episode"), root_world.hear("episode_plan")
    weights, commands = world.hear("policy"), world.hear("torque")
    world.processes.start("trainer")
    world.processes.start("simulator")
    world.wait(lambda: bool(plans))
    world.processes.start("controller")
    last = TrainingParameters().nominal_episodes + 1  # the first under a policy of its own
    world.wait(lambda: any(e.episode == last and e.phase == Episode.ENDED for e in episodes), 1500.0)
    first = {e.episode: e for e in reversed(episodes) if e.phase == Episode.RUNNING and not e.controller}
    begun = [first[number] for number in sorted(first)[:last]]  # an announcement may come twice
    asked = [(plan.seed, plan.sigma, plan.policy_version) for plan in plans[:last]]
    assert [(e.seed, e.sigma, e.policy_version) for e in begun] == asked
    versions = [plan.policy_version for plan in plans[:last]]
    assert versions == ["zero"] * (last - 1) + [weights[0].version]
    for number, version in enumerate(versions, 1):
        assert {c.policy_version for c in commands if c.episode == number} == {version}
    outcomes = {e.episode: e.outcome for e in episodes if e.phase == Episode.ENDED}
    assert "walked" in outcomes.values()
    assert not set(outcomes.values()) & {"fault", "silent", "reset"}


def test_a_trainer_is_followed_while_it_is_there(world: Any) -> None:
    """Before it comes and after it leaves, the simulator counts its own seeds on."""
    episodes, plans = world.hear("episode"), world.hear("episode_plan")
    begun: list[Episode] = []  # of this stage

    def walks(seeds: Any) -> bool:
        """Whether an episode began in this stage with one of these seeds, or with its own."""
        begun[:] = [e for e in episodes[stage:] if e.phase == Episode.RUNNING and not e.controller]
        return any(e.seed == (e.episode if seeds is None else seeds.get(e.episode)) for e in begun)

    stage = 0
    world.walk(PARAMETERS.model_dump(), trainer="auto", episodes=1_000_000, **{**PLANT.model_dump(), "stones": 1})
    world.wait(lambda: walks(None))
    world.start("trainer", **TRAINING.model_dump(mode="json"))
    world.wait(lambda: walks({plan.after_episode + 1: plan.seed for plan in plans}))
    world.processes.stop(("trainer",))
    stage = len(episodes)
    world.wait(lambda: walks(None))


def test_a_trainer_whose_learning_diverges_ends_at_once(world: Any) -> None:
    """With one line that says so; nobody waits until the simulator gives it up."""
    world.start("simulator", trainer="wait", episodes=3, trainer_timeout=80000.0, **PLANT.model_dump())
    world.start("controller", **PARAMETERS.model_dump())
    rates = {"actor_rate": 1.0, "critic_rate": 1.0}
    world.start("trainer", **(TRAINING.model_dump(mode="json") | rates | {"updates_least": 200}))
    world.go()
    with pytest.raises(NodeEnded, match=r"the trainer ended.*the learning diverged.*smaller learning rates") as ended:
        world.wait(lambda: False)
    assert ended.value.code == ExitCode.NODE_DIED
    assert "Traceback" not in world.log("trainer")
    world.processes.stop(("trainer",))
