"""What policies may see of a tick: an actor its observation, the oracle the model's terms besides."""

from dataclasses import dataclass

from cbf_clf_qp.tick import Terms
from rabbit_description.state import Array

from rl_cbf_clf_controller.scene import Scene


@dataclass(frozen=True)
class PolicyContext:
    """All an actor may see at a tick: `observation` (14,) or (15,), raw, see `Problem.observation`; `LgV` (4,)."""

    observation: Array
    LgV: Array


@dataclass(frozen=True)
class ModelContext(PolicyContext):
    """What only the oracle sees besides: the tick's nominal terms."""

    terms: Terms[Scene]

    @classmethod
    def of(cls, terms: Terms[Scene]) -> "ModelContext":
        """Of a tick's terms."""
        return cls(terms.scene.observation, terms.scene.LgV, terms)
