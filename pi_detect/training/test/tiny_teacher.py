"""A small network with the operators, names and outputs of YOLOX-nano's ONNX file, with random weights."""

import torch
from torch import nn

CLASSES = 80


class _Head(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.cls_preds = nn.ModuleList(nn.Conv2d(channels, CLASSES, 1) for _ in range(3))
        self.reg_preds = nn.ModuleList(nn.Conv2d(channels, 4, 1) for _ in range(3))
        self.obj_preds = nn.ModuleList(nn.Conv2d(channels, 1, 1) for _ in range(3))


class TinyTeacher(nn.Module):
    """forward() returns n x cells x 85 with sigmoids applied, as the published file."""

    def __init__(self):
        super().__init__()
        self.stem = nn.Conv2d(12, 4, 3, 2, 1)
        self.deeper = nn.ModuleList(nn.Conv2d(4, 4, 3, 2, 1) for _ in range(3))
        self.joined = nn.ModuleList(nn.Conv2d(8, 4, 1) for _ in range(2))
        self.head = _Head(4)
        for conv in self.head.obj_preds:
            conv.bias.data -= 8  # no boxes

    def forward(self, x):
        patches = [x[..., row::2, column::2] for column in range(2) for row in range(2)]
        x = nn.functional.silu(self.stem(torch.cat(patches, 1)))
        maps = []
        for layer in self.deeper:
            x = nn.functional.silu(layer(x))
            maps.append(x)
        maps[2] = maps[2] + nn.functional.max_pool2d(maps[2], 5, 1, 2)
        for i in (1, 0):
            up = nn.functional.interpolate(maps[i + 1], scale_factor=2.0, mode="nearest")
            maps[i] = self.joined[i](torch.cat([up, maps[i]], 1))
        outputs = [torch.cat([self.head.reg_preds[i](level), torch.sigmoid(self.head.obj_preds[i](level)),
                              torch.sigmoid(self.head.cls_preds[i](level))], 1) for i, level in enumerate(maps)]
        return torch.cat([output.reshape(-1, 5 + CLASSES, output.shape[2] * output.shape[3]) for output in outputs],
                         2).permute(0, 2, 1)


def write(path, size=416):
    """@return the network"""
    torch.manual_seed(5)
    network = TinyTeacher().eval()
    torch.onnx.export(network, torch.zeros(1, 3, size, size), str(path), input_names=["images"],
                      output_names=["output"], opset_version=11)
    return network
