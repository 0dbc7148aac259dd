"""The actor: observation to alpha and beta of every quantity, in torch; `rl_cbf_clf_controller.policy` is its twin."""

from typing import Any

import torch
from rl_cbf_clf_controller.weights import PROBE, Arrays, probe_inputs
from torch import Tensor, nn

from rl_trainer.parameters import TrainingParameters

FIRST_OUTPUTS = 0.01  # an untrained actor is nearly the zero policy


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
        return (observation - self.center) / self.scale


def hidden_layers(inputs: int, parameters: TrainingParameters, outputs: int, last: float = 1.0) -> nn.Sequential:
    """The paper's two hidden layers with ReLU; the last layer's first weights are multiplied by `last`."""
    first, second = parameters.hidden1, parameters.hidden2
    layers = nn.Sequential(
        *(nn.Linear(inputs, first), nn.ReLU(), nn.Linear(first, second), nn.ReLU(), nn.Linear(second, outputs))
    )
    with torch.no_grad():
        for parameter in layers[-1].parameters():
            parameter.mul_(last)
    return layers


class Actor(nn.Module):
    """A network, tanh outputs in [-1, 1], action scales, and the structured CLF row."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        self.n, self.m = parameters.n, parameters.problem.inputs
        self.structured, self.has_clf = parameters.is_structured, parameters.problem.has_clf
        self.hidden = (parameters.hidden1, parameters.hidden2)
        self.scaling = Scaling(parameters)
        matrix, others = (self.m if self.structured else 0), self.n - self.structured
        alphas = ([1.0] * self.m + [0.0]) * matrix + [1.0] * self.m * others + [0.0] * others
        inputs = len(parameters.observation)
        self.network: Any = hidden_layers(inputs, parameters, len(alphas), FIRST_OUTPUTS)
        self.alpha_scale: Tensor
        self.beta_scale: Tensor
        for name, scales in zip(("alpha_scale", "beta_scale"), parameters.scales, strict=False):
            self.register_buffer(name, torch.tensor(scales))
        self._alphas = torch.tensor(alphas)[:, None]  # 1 where an output belongs to an alpha, 0 to a beta

    def forward(self, observation: Tensor, LgV: Tensor) -> tuple[Tensor, Tensor]:
        """Raw observation (b, m), LgV (b, p) to alpha (b, n, p) and beta (b, n), in the quantities' units."""
        size = self.clf_size(LgV)
        return self.in_units(self.unit_action(observation, LgV, size), size)

    def unit_action(self, observation: Tensor, LgV: Tensor, size: Tensor) -> Tensor:
        """All alphas, then all betas, (b, (p + 1) n), over their `units`; `size` is that of `clf_size`."""
        outputs, m = self.outputs(self.scaling(observation)), self.m
        if not self.structured:
            return outputs
        matrix = outputs[:, : m * (m + 1)].reshape(-1, m, m + 1)
        clf = torch.bmm((LgV / size[:, :1])[:, None], matrix)[:, 0]
        others = outputs[:, m * (m + 1) :]
        alphas = m * (self.n - 1)
        return torch.cat([clf[:, :m], others[:, :alphas], clf[:, m:], others[:, alphas:]], 1)

    def in_units(self, flat: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
        """Alpha (b, n, p) and beta (b, n) of a `unit_action`, in the quantities' units."""
        alphas, (alpha_unit, beta_unit) = self.m * self.n, self.units(size)
        return flat[:, :alphas].reshape(-1, self.n, self.m) * alpha_unit, flat[:, alphas:] * beta_unit

    def units(self, size: Tensor) -> tuple[Tensor, Tensor]:
        """The scales of alpha (b, n, 1) and beta (b, n), for V times |LgV| + 1."""
        return self.alpha_scale[:, None] * size[..., None], self.beta_scale * size

    def clf_size(self, LgV: Tensor) -> Tensor:
        """|LgV| + 1 for V and 1 for all else, (b, n)."""
        size = torch.ones(len(LgV), self.n)
        if self.has_clf:
            size[:, 0] += torch.linalg.vector_norm(LgV, dim=1)
        return size

    def outputs(self, scaled: Tensor) -> Tensor:
        """The tanh outputs in the order of the policy file, (b, outputs)."""
        return torch.tanh(self.network(scaled))

    @torch.no_grad()
    def steady_alphas(self, share: float) -> None:
        """Take `share` off the last layer's weights, not biases, of every alpha: what varies with the state decays."""
        self.network[-1].weight.mul_(1 - share * self._alphas)

    @torch.no_grad()
    def arrays(self) -> Arrays:
        """The weights with the probe's outputs, for a `PolicyFile`."""
        values = {PROBE: self.outputs(torch.from_numpy(probe_inputs(len(self.scaling.center))))}
        for i, layer in enumerate(self.network[::2]):
            values |= {f"{i}.weight": layer.weight, f"{i}.bias": layer.bias}
        return {name: value.numpy().copy() for name, value in values.items()}

    @torch.no_grad()
    def load_arrays(self, arrays: Arrays) -> None:
        """The inverse of `arrays`, for arrays of the same shapes."""
        for i, layer in enumerate(self.network[::2]):
            layer.weight.copy_(torch.tensor(arrays[f"{i}.weight"]))
            layer.bias.copy_(torch.tensor(arrays[f"{i}.bias"]))
