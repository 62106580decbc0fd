#!/usr/bin/python3
"""Exports the averaged weights of a checkpoint to ONNX and checks them in OpenCV's dnn module.

  export.py --data FOLDER --work FOLDER --output street.onnx [--input-size 256]

Writes the network (batch norm folded into the convolutions) and, beside it, the model's description for pi_detect, a
YAML file of the same name (model_description.py). Fails if OpenCV's numbers differ from PyTorch's by more than the
tolerance, and writes no description then.
"""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from PIL import Image
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

import model_description
from augment import stretch
from dataset import normalise
from label_set import CLASSES
from model import STRIDES
from train import input_size, make_model

TOLERANCE = 1e-3     # of the outputs (logits) between PyTorch and OpenCV
OPSET = 11           # the newest that OpenCV 4.6 covers for these layers
CHECK_PICTURES = 16


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
                      output_names=["cells"], opset_version=OPSET)
    model = onnx.load(str(path))
    inline_shared_initializers(model.graph)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def largest_difference(network, path, pictures):
    """Largest absolute difference of the outputs between PyTorch and OpenCV, over pictures S x S x 3."""
    in_opencv = cv2.dnn.readNet(str(path))
    largest = 0.0
    for pixels in pictures:
        with torch.no_grad():
            expected = network(normalise(torch.from_numpy(pixels.transpose(2, 0, 1).copy())[None])).numpy()
        in_opencv.setInput(cv2.dnn.blobFromImage(pixels, 1 / 127.5, pixels.shape[:2], (127.5,) * 3))
        largest = max(largest, float(np.abs(in_opencv.forward().reshape(expected.shape) - expected).max()))
    return largest


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
    network = make_model(config)
    network.load_state_dict(checkpoint["average"]["model"])
    network.eval()
    fold_batch_norm(network)
    write_onnx(network, size, arguments.output)
    names = [entry["image"] for entry in json.loads((arguments.data / "labels.json").read_text())
             if entry["split"] == "val"]
    pictures = [stretch(Image.open(arguments.data / name).convert("RGB"), size) for name in names[:CHECK_PICTURES]]
    difference = largest_difference(network, arguments.output, pictures)
    if difference > TOLERANCE:
        raise SystemExit(f"{arguments.output}: OpenCV's outputs differ from PyTorch's by {difference:.2e}, "
                         f"allowed are {TOLERANCE:.0e}: do not use this file")
    description = model_description.describe(arguments.output, size, STRIDES, config["network"]["bins"], CLASSES,
                                             checkpoint["epoch"] + 1)
    model_description.write(arguments.output.with_suffix(".yaml"), description)
    print(f"{arguments.output}: {arguments.output.stat().st_size / 1e6:.2f} MB, largest difference to PyTorch "
          f"{difference:.2e}, sha256 {description['weights']['sha256']}")


if __name__ == "__main__":
    main()
