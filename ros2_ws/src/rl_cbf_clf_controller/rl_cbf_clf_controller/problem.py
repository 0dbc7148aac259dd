"""A learning problem: names and sizes, from which the actor's network, the policy file and a transition follow.

    true value of each quantity = nominal value(mu) + alpha(x) mu + beta(x)    [CLF_estimate], [eq:cbf_der], [eq_const]

A policy reads the m observations and gives alpha (n, inputs) and beta (n,) of the n quantities.
"""

import math
from dataclasses import dataclass

Scales = tuple[float, ...]
ROOM = 1.5  # of a scale that is measured, over what `QUANTILE` of the ticks stay below
QUANTILE = 0.99
LEAST = 1e-3  # a scale, where nothing was seen
Unit = tuple[str, float, float]


@dataclass(frozen=True)
class Problem:
    """What is learned for a controller.

    Args:
        name: of the controller.
        inputs: components of mu.
        quantities: names of the n learned quantities, in the order of every array over them. `V` comes first, if it
            is one of them: its row may then take the structured form.
        observation: names of what a policy reads of a state.
        units: name, centre and scale of each observation; the network reads (observation - centre) / scale.
        alpha_scale, beta_scale, error_scale: (n,), alpha, beta and their error at 1, in the quantities' units; those
            of V are multiplied by |LgV| + 1. Empty: the training parameters must give them.
        mu_unit: a typical component of mu.
        corrects_input: alpha and beta are no errors of quantities but a part of the input [approach1_input].
        omissible, optional: observations that a policy may do without, or may read besides.

    Raises:
        ValueError: sizes that do not fit together.
    """

    name: str
    inputs: int
    quantities: tuple[str, ...]
    observation: tuple[str, ...]
    units: tuple[Unit, ...]
    alpha_scale: Scales = ()
    beta_scale: Scales = ()
    error_scale: Scales = ()
    mu_unit: float = 50.0
    corrects_input: bool = False
    omissible: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        known = {name for name, *_ in self.units}
        missing = [name for name in (*self.observation, *self.optional) if name not in known]
        if missing:
            raise ValueError(f"problem {self.name}: units of {', '.join(missing)} are missing")
        for name in ("alpha_scale", "beta_scale", "error_scale"):
            scales = tuple(map(float, getattr(self, name)))
            if len(scales) not in (0, len(self.quantities)) or not all(0 < scale < math.inf for scale in scales):
                raise ValueError(f"problem {self.name}: {name} = {scales}; expected a positive number a quantity")
            object.__setattr__(self, name, scales)
        wrong = [unit for unit in self.units if not (math.isfinite(unit[1]) and 0 < unit[2] < math.inf)]
        if wrong or not 0 < self.mu_unit < math.inf:
            raise ValueError(f"problem {self.name}: units {wrong}, mu_unit = {self.mu_unit}; expected positive scales")
        if self.inputs < 1 or not self.quantities or "V" in self.quantities[1:]:
            raise ValueError(f"problem {self.name}: expected inputs, and quantities of which V is the first, if any")

    def __str__(self) -> str:
        return self.name

    @property
    def observations(self) -> tuple[tuple[str, ...], ...]:
        """All that a policy may read, the shortest first."""
        short = tuple(name for name in self.observation if name not in self.omissible)
        return tuple(dict.fromkeys((short, self.observation, (*self.observation, *self.optional))))

    @property
    def has_clf(self) -> bool:
        """V is among the quantities."""
        return "V" in self.quantities

    def unit(self, name: str) -> tuple[float, float]:
        """Centre and scale of an observation."""
        return next((center, scale) for known, center, scale in self.units if known == name)
