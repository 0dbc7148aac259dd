"""Building blocks: the paper's two hidden layers of 400 and 300, and the scaling of what goes in."""

import torch
from torch import Tensor, nn

from rl_trainer.parameters import TrainingParameters


class Scaling(nn.Module):
    """(raw observation - centre) / scale."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        units = torch.tensor([parameters.problem.unit(name) for name in parameters.observation])
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
