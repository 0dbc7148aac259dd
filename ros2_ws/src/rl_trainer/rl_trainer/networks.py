"""Building blocks: the paper's two hidden layers of 400 and 300, and the scaling of what goes in."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

MU_UNIT = 50.0  # rad/s^2, makes mu a network's input of about one

OBSERVATION_UNITS: dict[str, tuple[float, float]] = {  # centre and scale: what a walk of this robot spans
    **{f"y{i}": (0.0, 0.1) for i in range(1, 5)},  # rad
    **{f"dy{i}": (0.0, 1.5) for i in range(1, 5)},  # rad/s
    "hip_x": (0.0, 0.12),  # m
    "hip_z": (0.75, 0.03),  # m
    "phase": (0.5, 0.35),  # 1
    "hip_dx": (0.6, 0.25),  # m/s
    "hip_dz": (0.0, 0.2),  # m/s
    "dphase": (1.7, 0.7),  # 1/s
    "l_min": (0.35, 0.03),  # m
    "step_length": (0.4, 0.1),  # m
}


class Scaling(nn.Module):
    """(raw observation - centre) / scale."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__()
        units = torch.tensor([OBSERVATION_UNITS[name] for name in names])
        self.center: Tensor
        self.scale: Tensor
        self.register_buffer("center", units[:, 0].contiguous())
        self.register_buffer("scale", units[:, 1].contiguous())

    def forward(self, observation: Tensor) -> Tensor:
        """Shape (b, m) to (b, m)."""
        scaled: Tensor = (observation - self.center) / self.scale
        return scaled


def hidden_layers(inputs: int, hidden: tuple[int, int], outputs: int, last: float = 1.0) -> nn.Sequential:
    """Linear, ReLU, linear, ReLU, linear; the last layer's first weights are multiplied by `last`."""
    layers = nn.Sequential(
        nn.Linear(inputs, hidden[0]),
        nn.ReLU(),
        nn.Linear(hidden[0], hidden[1]),
        nn.ReLU(),
        nn.Linear(hidden[1], outputs),
    )
    with torch.no_grad():
        for parameter in layers[-1].parameters():
            parameter.mul_(last)
    return layers
