"""What policies may see of a tick: an actor its observation, the oracle the model terms besides."""

from dataclasses import dataclass

from rabbit_description.state import Array

from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.nominal_model import PinnedDynamics
from rl_cbf_clf_controller.quantities import QuantityModel


@dataclass(frozen=True)
class PolicyContext:
    """All an actor may see at a tick: `observation` (14,) or (15,), raw, see `Problem.observation`; `LgV` (4,)."""

    observation: Array
    LgV: Array


@dataclass(frozen=True)
class ModelContext(PolicyContext):
    """What only oracle and adaptation see besides: the state, stance/swing order, and the tick's nominal terms."""

    q_s: Array
    dq_s: Array
    quantities: QuantityModel
    dynamics: PinnedDynamics
    nominal: Affine
    precontrol: Affine
