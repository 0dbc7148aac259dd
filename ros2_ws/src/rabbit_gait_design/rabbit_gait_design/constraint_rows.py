"""Named rows lower <= value <= upper of a nonlinear programme."""

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from rabbit_description.state import Array

UNBOUNDED = np.inf


@dataclass
class ConstraintRows:
    """Rows in the order they were added, each under a name for error messages."""

    values: list[ca.SX] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def add(self, name: str, value: ca.SX, lower: float = 0.0, upper: float = UNBOUNDED) -> None:
        """Append `lower <= value <= upper`, element by element."""
        size = value.numel()
        self.values.append(ca.vec(value))
        self.lower += [lower] * size
        self.upper += [upper] * size
        self.names += [name] * size

    def equal(self, name: str, value: ca.SX) -> None:
        """Append `value = 0`."""
        self.add(name, value, 0.0, 0.0)

    def broken(self, rows: Array, tolerance: float = 1e-6) -> dict[str, float]:
        """Largest violation above `tolerance` of each name at the rows' values (n,), worst first."""
        excess = np.maximum(np.array(self.lower) - rows, rows - np.array(self.upper))
        worst: dict[str, float] = {}
        for name, value in zip(self.names, excess, strict=True):
            if not value <= tolerance:
                worst[name] = max(worst.get(name, 0.0), float(value))
        return dict(sorted(worst.items(), key=lambda item: -item[1]))
