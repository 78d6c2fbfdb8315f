"""The network of the paper (sec. 2.4): fully connected layers with ReLU and dropout between them."""

from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from scleraforce.learning.classifier.samples import Normalisation
from scleraforce.learning.framework import torch
from scleraforce.study import NetworkStudy


@dataclass(frozen=True)
class Layer:
    """A fully connected layer: y = weight x + bias. Shapes (output, input) and (output,)."""

    weight: NDArray[np.float32]
    bias: NDArray[np.float32]


@dataclass(frozen=True)
class TrainedNetwork:
    """Weights that read slices: pixels (0 to 1) minus `mean`, then the layers with ReLU between them, then softmax."""

    mean: NDArray[np.float32]
    layers: tuple[Layer, ...]

    def probabilities(self, slices: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return class probabilities in double precision, shape (slice, class): the definition, not the fast path."""
        signal = slices.reshape(len(slices), -1) / 255.0 - self.mean
        for layer in self.layers[:-1]:
            signal = np.maximum(signal @ layer.weight.T.astype(np.float64) + layer.bias, 0.0)
        logits = signal @ self.layers[-1].weight.T.astype(np.float64) + self.layers[-1].bias
        powers: NDArray[np.float64] = np.exp(logits - logits.max(axis=1, keepdims=True))
        powers /= powers.sum(axis=1, keepdims=True)
        return powers


def build_network(inputs: int, study: NetworkStudy, classes: int) -> torch.nn.Sequential:
    """Build the network with random weights (from PyTorch's generator); dropout follows every hidden layer.

    He's initialisation keeps the signal's variance through ReLU layers (He et al. 2015, eq. 10). Inverted dropout
    multiplies the second moment of what it passes by 1/keep, so the layers behind it start smaller by sqrt(keep):
    without that, logits start 1/keep = 5 times too large at the paper's dropout and the first steps diverge.
    """
    sizes = (inputs, *study.hidden, classes)
    modules: list[torch.nn.Module] = []
    for number, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        linear = torch.nn.Linear(fan_in, fan_out)
        keep = 1.0 - study.dropout if number else 1.0
        torch.nn.init.normal_(linear.weight, std=sqrt(2.0 * keep / fan_in))
        torch.nn.init.zeros_(linear.bias)
        modules += [linear, torch.nn.ReLU(), torch.nn.Dropout(study.dropout)]
    return torch.nn.Sequential(*modules[:-2])


def linear_layers(network: torch.nn.Sequential) -> list[torch.nn.Linear]:
    """Return the fully connected layers, in order."""
    return [module for module in network if isinstance(module, torch.nn.Linear)]


def trained_network(network: torch.nn.Sequential, norm: Normalisation) -> TrainedNetwork:
    """Return the weights as NumPy arrays, the first layer spread over all pixels (zero where a pixel never varied)."""
    layers = [
        Layer(linear.weight.detach().numpy().copy(), linear.bias.detach().numpy().copy())
        for linear in linear_layers(network)
    ]
    full = np.zeros((layers[0].weight.shape[0], norm.mean.size), dtype=np.float32)
    full[:, norm.varies] = layers[0].weight
    return TrainedNetwork(norm.mean, (Layer(full, layers[0].bias), *layers[1:]))
