"""The controllers that are compared, in the order and colours of every table and figure. A new one is a line here."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer import style
from rl_cbf_clf_controller.kinds import find_kind
from rl_cbf_clf_controller.parameters import load_parameters


@dataclass(frozen=True)
class Contender:
    """A controller by name, its policy (its own where None) and how it is drawn.

    It has the `parameters` of that file, and others by `tuning`, in an assembly of this `kind`.
    """

    title: str
    controller: str
    colour: str
    policy: str | None = None
    line: str = "-"
    tuning: tuple[tuple[str, Any], ...] = ()
    parameters: str = "ours"
    kind: Callable[..., Assembly] = Assembly

    def with_policy(self, policy: str) -> "Contender":
        """The same with another policy, by name or file."""
        return replace(self, policy=policy)

    def assembly(self, tuning: dict[str, Any] | None = None, /, **plant: Any) -> Assembly:
        """The controller on its own terrain, with evaluation's lag and its `tuning`; `plant`: the plant's.

        Raises:
            AssemblyError: no policy is shipped for it.
        """
        terrain = find_kind(self.controller).terrain
        changes = dict(self.tuning) | (tuning or {})
        controller = load_parameters(self.parameters, terrain, controller=self.controller, **changes)
        usual = {"motor_lag": EVALUATION_LAG, "terrain": terrain, "tick_seconds": controller.tick_seconds}
        simulation = SimulationParameters.model_validate({**usual, **plant})
        return self.kind(simulation, controller, resolve_policy(self.policy, controller))


RL_CLF = Contender("RL-CLF-QP", "rl-clf-qp", style.BLUE)
IO_RL = Contender("IO-RL + CLF-QP", "io-rl-clf-qp", style.ORANGE)
CLF = Contender("nominal CLF-QP", "clf-qp", style.BLACK, line="--")
CLF_ORACLE = Contender("RL-CLF-QP, oracle", "rl-clf-qp", style.GREEN, "oracle", ":")
L1_CLF = Contender("L1-CLF-QP", "l1-clf-qp", style.PURPLE, line="-.")
FLAT = (RL_CLF, IO_RL, L1_CLF, CLF)

RL_CBF_CLF = Contender("RL-CBF-CLF-QP", "rl-cbf-clf-qp", style.BLUE)
CBF_CLF = Contender("nominal CBF-CLF-QP", "cbf-clf-qp", style.BLACK, line="--")
CBF_CLF_ORACLE = Contender("RL-CBF-CLF-QP, oracle", "rl-cbf-clf-qp", style.GREEN, "oracle", ":")
ROBUST = Contender("robust CBF-CLF-QP", "robust-cbf-clf-qp", style.PURPLE, line="-.")
STONES = (RL_CBF_CLF, ROBUST, CBF_CLF)
RL_CBF_CLF_LIGHT = Contender("RL-CBF-CLF-QP trained at 0.7", "rl-cbf-clf-qp", style.SKY, "rl-cbf-clf-qp-scale-0.7")

LIBRARY = {"gait": "paper_stones"}  # presses on the ground under every payload (gaits.md), and so does this one:
SLOPES = {"gait": "slopes"}
LOW_TORQUE = {"gait": "low_torque"}  # for slopes too; on flat ground, where no barrier needs a high foot
GAIT = {"gait": "stones_0350_084"}
MARGIN = {"stone_margin": 0.01}
PD = {"objective": "pd_centred"}
IDENTIFIED = {"adaptation": "identification"}
PREDICTED = {"prediction": True}
INTEGRAL = {"speed_regulation": "integral"}


def variant(
    title: str, controller: str, policy: str, *tuning: dict[str, Any], kind: Callable[..., Assembly] = Assembly
) -> Contender:
    """One that stands in a map, so without a colour of its own."""
    parameters = {name: value for part in tuning for name, value in part.items()}
    return Contender(title, controller, style.BLACK, policy, tuning=tuple(parameters.items()), kind=kind)


AT_ITS_BEST = {  # the nominal controller's, as tuned for other masses and payloads (studies/docs/tuning.md)
    terrain: Contender("nominal at its best", kind, style.BLACK, "zero", parameters="nominal_tuned")
    for terrain, kind in (("stones", "cbf-clf-qp"), ("flat", "clf-qp"))
}
BEST = {
    terrain: Contender("best", kind, style.RED, "zero", parameters="best")
    for terrain, kind in (("stones", "rl-cbf-clf-qp"), ("flat", "rl-clf-qp"))
}
