#!/usr/bin/python3
"""Exports the averaged weights of a checkpoint to ONNX and checks them in OpenCV's dnn module.

  export.py --data FOLDER --work FOLDER --output ssd_street.onnx [--input-size 288]

Writes the network (batch norm folded into the convolutions, class scores through the sigmoid) and, beside it, the
model's description for pi_detect, a YAML file of the same name (model_description.py). Fails if OpenCV's numbers differ
from PyTorch's by more than the tolerance, and writes no description then.
"""

import argparse
from pathlib import Path

import numpy as np
import onnx
import torch
from PIL import Image
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

import dnn_forward
import model_description
from dataset import normalise
from label_set import CLASSES, load_records
from train import input_size, make_layout, make_model

TOLERANCE = 1e-3     # of box codes and scores between PyTorch and OpenCV
OPSET = 11           # the newest that OpenCV 4.6 covers for these layers
CHECK_PICTURES = 16


class Exported(nn.Module):
    """The network with scores instead of logits."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, picture):
        codes, logits = self.network(picture)
        return codes, torch.sigmoid(logits)


def fold_batch_norm(module):
    """Replaces every convolution and batch norm pair inside Sequentials by one convolution, in place."""
    for child in module.children():
        is_pair = (isinstance(child, nn.Sequential) and isinstance(child[0], nn.Conv2d) and len(child) > 1 and
                   isinstance(child[1], nn.BatchNorm2d))
        if is_pair:
            child[0] = fuse_conv_bn_eval(child[0], child[1])
            del child[1]
        else:
            fold_batch_norm(child)


def inline_shared_initializers(graph):
    """PyTorch merges equal weights through Identity nodes, which OpenCV 4.6 cannot read: uses the weights directly."""
    weights = {weight.name for weight in graph.initializer}
    aliases = {node.output[0]: node.input[0] for node in graph.node
               if node.op_type == "Identity" and node.input[0] in weights}
    kept = [node for node in graph.node if node.op_type != "Identity" or node.output[0] not in aliases]
    for node in kept:
        for i, name in enumerate(node.input):
            node.input[i] = aliases.get(name, name)
    del graph.node[:]
    graph.node.extend(kept)


def write_onnx(network, size, path):
    torch.onnx.export(network, torch.zeros(1, 3, size, size), str(path), input_names=["picture"],
                      output_names=["boxes", "scores"], opset_version=OPSET)
    model = onnx.load(str(path))
    inline_shared_initializers(model.graph)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def largest_differences(network, program, path, pictures, size):
    """Largest absolute difference of box codes and scores between PyTorch and OpenCV, and OpenCV's forward times.

    The pictures are written at the network's own size, so that no resampling comes between the two.
    """
    exact = []
    for number, picture in enumerate(pictures):
        with Image.open(picture) as image:
            exact.append(program.parent / f"check_{number}.png")
            image.convert("RGB").resize((size, size)).save(exact[-1])
    pixels = np.stack([np.asarray(Image.open(file)) for file in exact]).transpose(0, 3, 1, 2)
    with torch.no_grad():
        expected = [output.numpy() for output in network(normalise(torch.from_numpy(pixels)))]
    outputs, times = dnn_forward.forward(program, path, exact, size)
    for file in exact:
        file.unlink()
    return [float(np.abs(outputs[name].reshape(value.shape) - value).max())
            for name, value in zip(("boxes", "scores"), expected)], times


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of labels.json, for the check")
    parser.add_argument("--work", type=Path, required=True, help="folder with checkpoint.pt")
    parser.add_argument("--output", type=Path, required=True, help="ONNX file to write")
    parser.add_argument("--input-size", type=int, help="pixels, default: the last size of the training")
    arguments = parser.parse_args()
    checkpoint = torch.load(arguments.work / "checkpoint.pt", map_location="cpu")
    config = checkpoint["config"]
    size = arguments.input_size or input_size(config, config["epochs"] - 1)
    layout = make_layout(config, size)
    model = make_model(config)
    model.load_state_dict(checkpoint["average"]["model"])
    model.eval()
    fold_batch_norm(model)
    network = Exported(model)
    write_onnx(network, size, arguments.output)
    pictures = [arguments.data / record.image for record in load_records(arguments.data, "val")[:CHECK_PICTURES]]
    program = dnn_forward.build(arguments.work)
    differences, times = largest_differences(network, program, arguments.output, pictures, size)
    print(f"largest difference to PyTorch: boxes {differences[0]:.2e}, scores {differences[1]:.2e}; "
          f"forward median {times['median_ms']:.1f} ms, min {times['min_ms']:.1f} ms")
    if max(differences) > TOLERANCE:
        raise SystemExit(f"{arguments.output}: OpenCV's outputs differ from PyTorch's by {max(differences):.2e}, "
                         f"allowed are {TOLERANCE:.0e}: do not use this file")
    description = model_description.describe(arguments.output, layout, CLASSES, checkpoint["epoch"] + 1)
    model_description.write(arguments.output.with_suffix(".yaml"), description)
    print(f"{arguments.output}: {arguments.output.stat().st_size / 1e6:.2f} MB, {len(layout.boxes())} priors, "
          f"sha256 {description['weights']['sha256']}")


if __name__ == "__main__":
    main()
