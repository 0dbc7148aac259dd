"""The actor: observation to alpha and beta of every quantity, in torch; `rl_cbf_clf_controller.policy` is its twin.

Its last layer has one row for each output; with `shared = False` every quantity has a network of its own, and the file
holds them as blocks of one wide network, so that the controller needs to know of one form only.
"""

import numpy as np
import torch
from rl_cbf_clf_controller.weights import PROBE, Arrays, probe_inputs
from torch import Tensor, nn

from rl_trainer.networks import Scaling, hidden_layers
from rl_trainer.parameters import TrainingParameters

FIRST_OUTPUTS = 0.01  # an untrained actor is nearly the zero policy


class Actor(nn.Module):
    """Networks, tanh outputs in [-1, 1], action scales, and the structured CLF row."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        self.n, self.structured = parameters.n, parameters.is_structured
        self.has_clf, self._m = parameters.problem.has_clf, parameters.problem.inputs
        self.scaling = Scaling(parameters)
        m, rows = self._m, self._m + 1  # alpha and beta of a quantity
        sizes = [m * rows if self.structured and i == 0 else rows for i in range(self.n)]
        self._sizes = [sum(sizes)] if parameters.shared else sizes
        self.networks = nn.ModuleList(self._network(size, parameters) for size in self._sizes)
        self.hidden = (parameters.hidden1 * len(self.networks), parameters.hidden2 * len(self.networks))
        alpha, beta, _ = parameters.scales
        self.alpha_scale: Tensor
        self.beta_scale: Tensor
        self.register_buffer("alpha_scale", torch.tensor(alpha))
        self.register_buffer("beta_scale", torch.tensor(beta))
        self._alphas = [rows[:, None] for rows in self._alpha_rows()]

    def forward(self, observation: Tensor, LgV: Tensor) -> tuple[Tensor, Tensor]:
        """Raw observation (b, m), LgV (b, p) to alpha (b, n, p) and beta (b, n), in the quantities' units."""
        size = self.clf_size(LgV)
        return self.in_units(self.unit_action(observation, LgV, size), size)

    def unit_action(self, observation: Tensor, LgV: Tensor, size: Tensor) -> Tensor:
        """All alphas, then all betas, (b, (p + 1) n), over their `units`; `size` is that of `clf_size`."""
        outputs, m = self.outputs(self.scaling(observation)), self._m
        if not self.structured:
            return outputs
        matrix = outputs[:, : m * (m + 1)].reshape(-1, m, m + 1)
        clf = torch.bmm((LgV / size[:, :1])[:, None], matrix)[:, 0]
        others = outputs[:, m * (m + 1) :]
        alphas = m * (self.n - 1)
        return torch.cat([clf[:, :m], others[:, :alphas], clf[:, m:], others[:, alphas:]], 1)

    def in_units(self, flat: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
        """Alpha (b, n, p) and beta (b, n) of a `unit_action`, in the quantities' units."""
        alphas, (alpha_unit, beta_unit) = self._m * self.n, self.units(size)
        return flat[:, :alphas].reshape(-1, self.n, self._m) * alpha_unit, flat[:, alphas:] * beta_unit

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
        if len(self.networks) == 1:
            return torch.tanh(self.networks[0](scaled))
        outputs = torch.cat([network(scaled) for network in self.networks], 1)
        return torch.tanh(outputs[:, self._order()])

    @torch.no_grad()
    def steady_alphas(self, share: float) -> None:
        """Take `share` off the last layer's weights, not biases, of every alpha: what varies with the state decays."""
        for network, rows in zip(self._linears(), self._alphas, strict=True):
            network[-1].weight.mul_(1 - share * rows)

    def arrays(self) -> Arrays:
        """Weights as one network, with the probe's outputs, for a `PolicyFile`."""
        linears = self._linears()
        weights = [torch.cat([row[0].weight for row in linears])]
        weights += [torch.block_diag(*(row[i].weight for row in linears)) for i in (1, 2)]
        biases = [torch.cat([row[i].bias for row in linears]) for i in range(3)]
        weights[2], biases[2] = weights[2][self._order()], biases[2][self._order()]
        with torch.no_grad():
            probe = self.outputs(torch.from_numpy(probe_inputs(len(self.scaling.center))))
        named = {f"{i}.weight": weights[i] for i in range(3)} | {f"{i}.bias": biases[i] for i in range(3)}
        return {
            name: np.ascontiguousarray(value.detach().numpy(), dtype=np.float32)
            for name, value in (named | {PROBE: probe}).items()
        }

    @torch.no_grad()
    def load_arrays(self, arrays: Arrays) -> None:
        """The inverse of `arrays`, for arrays of the same shapes.

        Raises:
            ValueError: a network for each quantity was expected, and these are not.
        """
        given = {name: torch.from_numpy(array.copy()) for name, array in arrays.items()}
        back = torch.argsort(self._order())
        given |= {name: given[name][back] for name in ("2.weight", "2.bias")}
        for i, layers in enumerate(zip(*self._linears(), strict=True)):
            outputs = [layer.out_features for layer in layers]
            rows = zip(given[f"{i}.weight"].split(outputs), given[f"{i}.bias"].split(outputs), strict=True)
            for k, (layer, (weight, bias)) in enumerate(zip(layers, rows, strict=True)):
                first = k * layer.in_features if i else 0
                layer.weight.copy_(weight[:, first : first + layer.in_features])
                layer.bias.copy_(bias)
        if any(not np.array_equal(array, arrays[name]) for name, array in self.arrays().items() if name != PROBE):
            raise ValueError("shared = False: expected a network for each quantity, found one for all")

    def _network(self, outputs: int, parameters: TrainingParameters) -> nn.Sequential:
        hidden = (parameters.hidden1, parameters.hidden2)
        return hidden_layers(len(parameters.observation), hidden, outputs, FIRST_OUTPUTS)

    def _linears(self) -> list[list[nn.Linear]]:
        """The three layers of each network."""
        networks = [network for network in self.networks if isinstance(network, nn.Sequential)]
        return [[layer for layer in network if isinstance(layer, nn.Linear)] for network in networks]

    def _alpha_rows(self) -> list[Tensor]:
        """1 where a network's output belongs to an alpha, 0 to a beta."""
        m, row = self._m, [1.0] * self._m + [0.0]
        matrix = row * m if self.structured else []
        if len(self._sizes) > 1:
            return [torch.tensor(matrix if i == 0 and self.structured else row) for i in range(self.n)]
        plain = self.n - 1 if self.structured else self.n
        return [torch.tensor(matrix + [1.0] * m * plain + [0.0] * plain)]

    def _order(self) -> Tensor:
        """The networks' outputs in the file's order: the CLF's matrix first, all alphas before all betas."""
        if len(self._sizes) == 1:
            return torch.arange(self._sizes[0])
        m, starts = self._m, np.concatenate([[0], np.cumsum(self._sizes)])
        matrix = list(range(m * (m + 1))) if self.structured else []
        plain = range(1 if self.structured else 0, self.n)
        alphas = [start + j for start in starts[list(plain)] for j in range(m)]
        betas = [start + m for start in starts[list(plain)]]
        return torch.tensor([*matrix, *alphas, *betas], dtype=torch.long)
