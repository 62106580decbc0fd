"""The street network: a small anchor-free detector (Li et al. 2020, "Generalized Focal Loss"), ready for OpenCV 4.6.

The backbone has plain 3x3 convolutions where maps are fine and channels are few, and depthwise separable ones (Howard
et al. 2017) at stride 32; per weight OpenCV's CPU code runs plain convolutions several times faster. A top-down and a
bottom-up path (Liu et al. 2018, PANet) join the maps of strides 8, 16 and 32; each has its own head.
"""

import functools
import math
from pathlib import Path

import torch
from torch import nn
import torch.nn.functional as F

STRIDES = (8, 16, 32)


def conv_bn(inputs, outputs, kernel=3, stride=1, groups=1, relu=True):
    """Convolution without bias, batch norm and optionally ReLU; padding keeps size / stride."""
    layers = [nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False),
              nn.BatchNorm2d(outputs)]
    if relu:
        layers.append(nn.ReLU(inplace=True))
    return nn.Sequential(*layers)


class Block(nn.Module):
    """Two convolutions, with a skip connection where the shapes allow it."""

    def __init__(self, first, second, has_skip):
        super().__init__()
        self.first, self.second, self.has_skip = first, second, has_skip

    def forward(self, x):
        y = self.second(self.first(x))
        return F.relu(x + y if self.has_skip else y)


def separable(inputs, outputs, stride=1, kernel=3):
    """Depthwise and pointwise convolution."""
    return Block(conv_bn(inputs, inputs, kernel, stride, groups=inputs), conv_bn(inputs, outputs, 1, relu=False),
                 stride == 1 and inputs == outputs)


def bottleneck(channels):
    """1x1 to half the channels, 3x3 back."""
    return Block(conv_bn(channels, channels // 2, 1), conv_bn(channels // 2, channels, relu=False), True)


class StreetNet(nn.Module):
    """Input N x 3 x S x S (S a multiple of 32, RGB, (value - 127.5) / 127.5).

    forward() returns rows of the cells (cells.py), N x cells x (classes + 4 bins): logits of the classes, then, for
    each side of the box (left, top, right, bottom), logits of a distribution over distances of 0 .. bins - 1 strides.
    """

    def __init__(self, classes, bins=8, stem=(24, 48), channels=(80, 160, 288), blocks=(3, 4, 3), head_channels=96):
        super().__init__()
        self.classes, self.bins = classes, bins
        self.stem = nn.Sequential(conv_bn(3, stem[0], stride=2), conv_bn(stem[0], stem[1], stride=2))
        c3, c4, c5 = channels
        self.stages = nn.ModuleList([
            nn.Sequential(conv_bn(stem[1], c3, stride=2), *[bottleneck(c3) for _ in range(blocks[0] - 1)]),
            nn.Sequential(conv_bn(c3, c4, stride=2), *[bottleneck(c4) for _ in range(blocks[1] - 1)]),
            nn.Sequential(separable(c4, c5, 2), *[separable(c5, c5) for _ in range(blocks[2] - 1)])])
        h = head_channels
        self.laterals = nn.ModuleList(conv_bn(c, h, 1, relu=False) for c in channels)
        self.context = separable(h, h, kernel=5)
        self.down = nn.ModuleList(separable(h, h) for _ in range(2))
        self.up = nn.ModuleList(separable(h, h, 2) for _ in range(2))
        self.heads = nn.ModuleList(nn.Sequential(separable(h, h), separable(h, h)) for _ in STRIDES)
        self.outputs = nn.ModuleList(nn.Conv2d(h, classes + 4 * bins, 1) for _ in STRIDES)
        self._initialise()

    def _initialise(self):
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
        for conv in self.outputs:
            nn.init.normal_(conv.weight, std=0.01)
            nn.init.zeros_(conv.bias)
            # Focal loss starts from a small prior probability of every class (Lin et al. 2017, section 3.3).
            nn.init.constant_(conv.bias[:self.classes], -math.log(99.0))

    def features(self, x):
        """The maps of the heads, finest first."""
        x = self.stem(x)
        maps = []
        for stage, lateral in zip(self.stages, self.laterals):
            x = stage(x)
            maps.append(lateral(x))
        p3, p4, p5 = maps
        p5 = self.context(F.relu(p5))
        p4 = self.down[1](F.relu(p4 + F.interpolate(p5, scale_factor=2.0, mode="nearest")))
        p3 = self.down[0](F.relu(p3 + F.interpolate(p4, scale_factor=2.0, mode="nearest")))
        p4 = p4 + self.up[0](p3)
        p5 = p5 + self.up[1](p4)
        return [head(level) for head, level in zip(self.heads, (p3, p4, p5))]

    def predict(self, features):
        return rows([output(level) for output, level in zip(self.outputs, features)])

    def forward(self, x):
        return self.predict(self.features(x))


def rows(maps):
    """Maps N x channels x rows x columns to N x cells x channels."""
    return torch.cat([level.permute(0, 2, 3, 1).flatten(1, 2) for level in maps], 1)


@functools.lru_cache(maxsize=None)
def has_fast_bfloat16():
    """Whether the CPU multiplies bfloat16 in hardware; elsewhere it takes ten times as long as float32."""
    flags = Path("/proc/cpuinfo").read_text()
    return "avx512_bf16" in flags or "amx_bf16" in flags


def autocast():
    return torch.autocast("cpu", dtype=torch.bfloat16, enabled=has_fast_bfloat16())
