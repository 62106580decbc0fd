"""The small SSD network (Liu et al. 2016) with depthwise separable convolutions (Howard et al. 2017).

A backbone of residual depthwise separable blocks gives maps at strides 8, 16 and 32; a top-down path (Lin et al. 2017,
nearest upsampling) carries context to the finer maps; two more strided blocks give strides 64 and 128. One head, shared
by the five maps, predicts for every prior 4 box codes and one logit per class.
"""

import math

import torch
from torch import nn
import torch.nn.functional as F


def conv_bn(inputs, outputs, kernel=3, stride=1, groups=1, relu=True):
    """Convolution without bias, batch norm and optionally ReLU; padding keeps size / stride."""
    layers = [nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False),
              nn.BatchNorm2d(outputs)]
    if relu:
        layers.append(nn.ReLU(inplace=True))
    return nn.Sequential(*layers)


class SeparableBlock(nn.Module):
    """Depthwise 3x3 and pointwise convolution, with a skip connection where the shapes allow it."""

    def __init__(self, inputs, outputs, stride=1):
        super().__init__()
        self.depthwise = conv_bn(inputs, inputs, 3, stride, groups=inputs)
        self.pointwise = conv_bn(inputs, outputs, 1, relu=False)
        self.has_skip = stride == 1 and inputs == outputs

    def forward(self, x):
        y = self.pointwise(self.depthwise(x))
        return F.relu(x + y if self.has_skip else y)


def separable_stage(inputs, outputs, blocks):
    """One strided block and blocks - 1 residual ones."""
    return nn.Sequential(SeparableBlock(inputs, outputs, 2),
                         *[SeparableBlock(outputs, outputs) for _ in range(blocks - 1)])


class SmallSsd(nn.Module):
    """Input N x 3 x S x S (S a multiple of 32, RGB, (value - 127.5) / 127.5).

    forward() returns the box codes (N x priors x 4, see box_coding.py) and the class logits (N x priors x classes);
    priors are ordered by map (finest first), row, column, prior of the cell, as priors.py lists them.
    """

    def __init__(self, classes, priors_per_cell, stem=(24, 48), channels=(96, 192, 320), blocks=(3, 5, 3),
                 head_channels=128):
        super().__init__()
        self.classes = classes
        self.stem = nn.Sequential(conv_bn(3, stem[0], 3, 2), conv_bn(stem[0], stem[1], 3, 2),
                                  SeparableBlock(stem[1], stem[1]))
        inputs = (stem[1],) + tuple(channels[:2])
        self.stages = nn.ModuleList(separable_stage(i, o, n) for i, o, n in zip(inputs, channels, blocks))
        self.laterals = nn.ModuleList(conv_bn(c, head_channels, 1, relu=False) for c in channels)
        self.smooth = nn.ModuleList(SeparableBlock(head_channels, head_channels) for _ in range(2))
        self.extras = nn.ModuleList(SeparableBlock(head_channels, head_channels, 2) for _ in range(2))
        self.head = SeparableBlock(head_channels, head_channels)
        self.box = nn.Conv2d(head_channels, priors_per_cell * 4, 1)
        self.score = nn.Conv2d(head_channels, priors_per_cell * classes, 1)
        self._initialise()

    def _initialise(self):
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
        for conv in (self.box, self.score):
            nn.init.normal_(conv.weight, std=0.01)
            nn.init.zeros_(conv.bias)
        # Focal loss starts from a small prior probability of every class (Lin et al. 2017, section 3.3).
        nn.init.constant_(self.score.bias, -math.log(99.0))

    def features(self, x):
        """The five maps of head_channels, finest first."""
        x = self.stem(x)
        maps = []
        for stage, lateral in zip(self.stages, self.laterals):
            x = stage(x)
            maps.append(lateral(x))
        c3, c4, c5 = maps
        p5 = F.relu(c5)
        p4 = self.smooth[1](F.relu(c4 + F.interpolate(p5, scale_factor=2.0, mode="nearest")))
        p3 = self.smooth[0](F.relu(c3 + F.interpolate(p4, scale_factor=2.0, mode="nearest")))
        p6 = self.extras[0](p5)
        p7 = self.extras[1](p6)
        return [p3, p4, p5, p6, p7]

    def forward(self, x):
        boxes, scores = [], []
        for level in self.features(x):
            level = self.head(level)
            n = level.shape[0]
            boxes.append(self.box(level).permute(0, 2, 3, 1).reshape(n, -1, 4))
            scores.append(self.score(level).permute(0, 2, 3, 1).reshape(n, -1, self.classes))
        return torch.cat(boxes, 1), torch.cat(scores, 1)
