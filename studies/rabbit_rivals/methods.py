"""What enters the benchmark from here; a method whose file or library is missing is left blank, with the reason."""

from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec

from rabbit_benchmark.methods import Method
from rabbit_experiments.assembly import Assembly, AssemblyError
from rabbit_reproduce.controllers import BEST, LIBRARY, MARGIN, Contender, variant
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_parts import Further, nothing_further
from rl_cbf_clf_controller.policy import Policy

from rabbit_rivals.gp_controller import GpController, gp_policy
from rabbit_rivals.joint_targets import JointTargetController, network_policy, reference_alone
from rabbit_rivals.mixture import MixedController
from rabbit_rivals.model_file import SHIPPED

CONFIDENCE = 1.0  # standard deviations; with 2, 40 % of the ticks on flat ground would be infeasible


class GpAssembly(Assembly):
    """An assembly with the cone programme; `policy` is a file of GPs."""

    kind = GpController

    def make_policy(self) -> Policy:
        if not find_spec("clarabel"):
            raise AssemblyError("policy", "it needs the library clarabel, which is not installed")
        return gp_policy(self.policy, self.controller.problem, CONFIDENCE)


class JointTargetAssembly(Assembly):
    """An assembly with joint targets; `policy` is a file of a network."""

    kind = JointTargetController

    def make_policy(self) -> Policy:
        return reference_alone() if self.policy == "zero" else network_policy(self.policy)


@dataclass(frozen=True)
class MixedAssembly(Assembly):
    """An assembly whose controller is mixed with a `student`."""

    kind = MixedController
    student: Contender

    def make_controller(self, further: Further = nothing_further) -> Controller:
        controller = super().make_controller(further)
        assert isinstance(controller, MixedController)
        controller.student = self.student.assembly().make_controller()
        return controller


def _mixed(controller: Contender, student: Contender | None) -> Contender:
    assert student
    return replace(controller, title="mixture", kind=partial(MixedAssembly, student=student))


def _joint_targets(name: str, title: str, policy: str, trained_on: str) -> Method:
    """The paths of the gait library in the steps on both terrains."""
    stones = variant(title, "cbf-clf-qp", policy, LIBRARY, MARGIN, kind=JointTargetAssembly)
    flat = variant(title, "clf-qp", policy, LIBRARY, kind=JointTargetAssembly)
    return Method(name, title, stones, flat, trained_on)


def _estimates(name: str, title: str, trained_on: str) -> Method:
    """A policy file for each terrain, with the gait that it was trained on, as the paper's policy."""
    stones = variant(title, "rl-cbf-clf-qp", shipped(f"{name}-stones"))
    return Method(name, title, stones, variant(title, "rl-clf-qp", shipped(f"{name}-flat")), trained_on)


def shipped(name: str) -> str:
    """The file of a model that comes with this package."""
    return str(SHIPPED / f"{name}.safetensors")


GP_SOCP = Method(
    "gp-socp",
    "GP-CBF-CLF-SOCP",
    variant("GP-SOCP", "rl-cbf-clf-qp", shipped("gp-socp-stones"), kind=GpAssembly),
    variant("GP-SOCP", "rl-clf-qp", shipped("gp-socp-flat"), kind=GpAssembly),
    "GPs at mass scale 2, no motor lag, seed 1: 6,727 transitions on stones, 7,567 on flat ground",
)
PLANTS = "in MuJoCo over random plants (storm, masses, development families)"
PD = _joint_targets("pd", "PD on the gait library", "zero", "")
PPO = _joint_targets("ppo", "PPO, joint targets", shipped("ppo"), f"PPO {PLANTS}: 20 million ticks, seed 2")
SAC = _joint_targets("sac", "SAC, joint targets", shipped("sac"), f"SAC {PLANTS}: 3 million ticks, seed 1")
DAGGER = _joint_targets(
    "dagger", "DAgger, joint targets", shipped("dagger"), f"DAgger {PLANTS}: 1.4 million ticks, seed 1"
)
MIXTURE = Method(
    "mixture",
    "best, a quarter of DAgger",
    _mixed(BEST["stones"], DAGGER.stones),
    _mixed(BEST["flat"], DAGGER.flat),
    f"what best learned; DAgger {PLANTS}; the share: development plants of all families",
)
DDPG_SB3 = _estimates(
    "ddpg-sb3",
    "DDPG of stable-baselines3",
    "DDPG at mass scale 2, no motor lag, seed 1: 20,000 ticks on stones, 20,000 on flat ground",
)
REGRESSION = _estimates(
    "regression",
    "regression",
    "supervised, at mass scale 2, no motor lag, seed 1: 6,800 transitions on stones, 7,151 on flat ground",
)
