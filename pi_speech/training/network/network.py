"""The word network: causal convolutions over time, a decision each 20 ms."""

import struct
from pathlib import Path

import numpy as np
import torch
from torch import nn

from front_end import BANDS
from sounds import WORDS

CHANNELS, STEM_KERNEL, STRIDE, KERNEL = 112, 5, 2, 3
DILATIONS = (1, 1, 2, 2, 4, 4, 6, 6)  # 1.1 s of past
MAGIC, VERSION = b"PIWNET1\n", 1


class Layer(nn.Module):
    """Causal convolution beside an identity."""

    def __init__(self, dilation):
        super().__init__()
        self.past = dilation * (KERNEL - 1)
        self.convolution = nn.Conv1d(CHANNELS, CHANNELS, KERNEL, dilation=dilation, bias=False)
        self.normal = nn.BatchNorm1d(CHANNELS)

    def forward(self, x):
        return x + torch.relu(self.normal(self.convolution(nn.functional.pad(x, (self.past, 0)))))


class WordNetwork(nn.Module):
    """Input: batch x BANDS x frames of front_end.normalise(). Output: batch x classes x steps, logits. Step s has seen
    frames 0 to 2 s + 1 and, before the first one, zeros."""

    def __init__(self):
        super().__init__()
        self.stem = nn.Conv1d(BANDS, CHANNELS, STEM_KERNEL, stride=STRIDE, bias=False)
        self.stem_normal = nn.BatchNorm1d(CHANNELS)
        self.layers = nn.ModuleList(Layer(dilation) for dilation in DILATIONS)
        self.head = nn.Conv1d(CHANNELS, len(WORDS) + 1, 1)

    def forward(self, x):
        x = nn.functional.pad(x, (STEM_KERNEL - STRIDE, 0))
        x = torch.relu(self.stem_normal(self.stem(x)))
        for layer in self.layers:
            x = layer(x)
        return self.head(x)

    def weights(self):
        return sum(parameter.numel() for parameter in self.parameters())


def _folded(weight, normal):
    """@return weight and bias of a convolution with the normalisation behind it."""
    scale = (normal.weight / torch.sqrt(normal.running_var + normal.eps)).detach()
    return weight.detach() * scale.reshape(-1, *[1] * (weight.dim() - 1)), (normal.bias
                                                                            - normal.running_mean * scale).detach()


def _check_sum(content):
    """FNV-1a."""
    value = 14695981039346656037
    for byte in content:
        value = (value ^ byte) * 1099511628211 % 2 ** 64
    return value


def save(network, path):
    """Writes the file that WordNetwork::load() of pi_speech reads. All numbers are little endian; matrices row by row,
    one row per output."""
    network.eval()
    parts = [struct.pack("<i", len(WORDS))]
    for word in WORDS:
        parts.append(struct.pack("<i", len(word)) + word.encode())
    parts.append(struct.pack("<5i", BANDS, CHANNELS, STEM_KERNEL, KERNEL, len(DILATIONS)))
    parts.append(struct.pack(f"<{len(DILATIONS)}i", *DILATIONS))

    def put(matrix):
        parts.append(np.ascontiguousarray(matrix.detach().numpy(), dtype="<f4").tobytes())

    for convolution, normal in [(network.stem, network.stem_normal),
                                *((layer.convolution, layer.normal) for layer in network.layers)]:
        weight, bias = _folded(convolution.weight, normal)
        put(weight.permute(0, 2, 1))  # output, time, input
        put(bias)
    put(network.head.weight[:, :, 0])
    put(network.head.bias)
    content = b"".join(parts)
    Path(path).write_bytes(MAGIC + struct.pack("<IQQ", VERSION, len(content), _check_sum(content)) + content)
