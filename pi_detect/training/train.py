#!/usr/bin/python3
"""Trains the street network on the CPU; goes on from the last finished epoch when it is started again.

  train.py --data FOLDER --work FOLDER --teacher yolox_nano.onnx [--config training.json] [--threads 2]

Writes to the work folder: pid, teacher.json (the teacher's boxes), checkpoint.pt (after every epoch, atomically),
log.csv (one line an epoch), the decoded pictures (train.rgb, val.rgb) and the configuration of the run.
"""

import argparse
import copy
import csv
import fcntl
import json
import math
import os
import sys
import time
from pathlib import Path

import numpy as np
import torch

import package_path  # noqa: F401  (leads to pi_detect)
from augment import AugmentOptions, stretch
from cells import cells, select_detections
from dataset import TrainingSet, collate, normalise
from label_set import CLASSES, PictureStore, human_truth, load_records, target_truth
from losses import LEAST_LOGIT, decode, detection_loss, distillation_loss
from model import STRIDES, StreetNet, autocast, rows
from pi_detect.average_precision import evaluate
from teacher import Teacher, write_boxes

TEACHER_LOGITS = 81  # classes and objectness


class MovingAverage:
    """Exponential average of a model's weights; batch-norm statistics are averaged alike."""

    def __init__(self, model, decay):
        self.model = copy.deepcopy(model).eval()
        self._decay = decay
        self._steps = 0

    @torch.no_grad()
    def update(self, model):
        self._steps += 1
        # The short average of the first steps forgets the random start sooner.
        decay = min(self._decay, (1 + self._steps) / (10 + self._steps))
        for average, value in zip(self.model.state_dict().values(), model.state_dict().values()):
            if average.dtype.is_floating_point:
                average.lerp_(value, 1 - decay)
            else:
                average.copy_(value)

    def state(self):
        return {"model": self.model.state_dict(), "steps": self._steps}

    def load(self, state):
        self.model.load_state_dict(state["model"])
        self._steps = state["steps"]


def input_size(config, epoch):
    """Progressive resizing: the size of the last entry [first epoch, size] that has begun."""
    return [size for first, size in config["input_sizes"] if first <= epoch][-1]


def learning_rate(config, step, steps):
    """Linear warm-up, then a half cosine down to 1 % of the peak."""
    if step < config["warm_up_steps"]:
        return config["learning_rate"] * (step + 1) / config["warm_up_steps"]
    progress = (step - config["warm_up_steps"]) / max(1, steps - config["warm_up_steps"])
    return config["learning_rate"] * (0.01 + 0.99 * (1 + math.cos(math.pi * progress)) / 2)


def make_model(config):
    return StreetNet(len(CLASSES), **config["network"])


class Pupil(torch.nn.Module):
    """The network with a helper that tells, from the heads' maps, the teacher's logits of all 80 classes and its
    objectness: only training needs it."""

    def __init__(self, network, teacher_outputs):
        super().__init__()
        self.network = network
        self.helpers = torch.nn.ModuleList(
            torch.nn.Conv2d(output.in_channels, teacher_outputs, 1) for output in network.outputs)
        for helper in self.helpers:
            torch.nn.init.constant_(helper.bias, LEAST_LOGIT)

    def forward(self, x):
        features = self.network.features(x)
        return self.network.predict(features), rows([helper(level) for helper, level in zip(self.helpers, features)])


def make_optimizer(model, config):
    """AdamW (Loshchilov and Hutter 2019); biases and batch-norm weights do not decay."""
    decayed = [p for p in model.parameters() if p.dim() > 1]
    plain = [p for p in model.parameters() if p.dim() <= 1]
    return torch.optim.AdamW([{"params": decayed, "weight_decay": config["weight_decay"]},
                              {"params": plain, "weight_decay": 0.0}], lr=config["learning_rate"])


@torch.no_grad()
def detect(network, pictures):
    """Detections of single pictures (arrays S x S x 3), rows [class, score, x1, y1, x2, y2] in 0..1, per picture."""
    size = pictures[0].shape[0]
    place = torch.from_numpy(cells(size, STRIDES))
    results = []
    for start in range(0, len(pictures), 16):
        batch = torch.from_numpy(np.stack(pictures[start:start + 16]).transpose(0, 3, 1, 2))
        with autocast():
            outputs = network(normalise(batch))
        outputs = outputs.float()
        scores = torch.sigmoid(outputs[..., :network.classes]).numpy()
        boxes = decode(outputs[..., network.classes:].unflatten(-1, (4, -1)), place).numpy() / size
        results += [select_detections(box, score) for box, score in zip(boxes, scores)]
    return results


def validate(network, store, records, size):
    """Average precision per class, against people's boxes and against the training targets of the split."""
    detections = detect(network, [stretch(store.image(record), size) for record in records])
    for found, record in zip(detections, records):
        found[:, 2:] *= np.asarray([record.width, record.height] * 2)
    return (evaluate(detections, [human_truth(r) for r in records], len(CLASSES)),
            evaluate(detections, [target_truth(r) for r in records], len(CLASSES)))


def train_epoch(pupil, teacher, average, optimizer, loader, size, config, first_step, steps):
    """One pass; returns the mean losses: classification, box, distribution, distillation."""
    pupil.train()
    place = torch.from_numpy(cells(size, STRIDES))
    weights = torch.tensor([1.0] + [config[f"{name}_weight"] for name in ("box", "distribution", "distillation")])
    sums, count = np.zeros(len(weights)), 0
    for number, (pixels, samples) in enumerate(loader):
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(config, first_step + number, steps)
        with autocast():
            outputs, helper = pupil(normalise(pixels))
            # x, y, width, height come first: they are in the boxes of the samples already.
            wanted = teacher(pixels)[..., 4:].roll(-1, -1)
        losses = torch.stack([*detection_loss(outputs.float(), place, samples, len(CLASSES)),
                              distillation_loss(helper.float(), wanted)])
        loss = (losses * weights).sum()
        if not torch.isfinite(loss):
            raise FloatingPointError(f"the loss is {loss.item()} in step {first_step + number}: "
                                     "lower learning_rate and start again from the last checkpoint")
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        # PyTorch 1.13's bfloat16 gradient of a depthwise convolution is not a number now and then (seen with inputs
        # below 160 pixels): such a step is left out.
        if torch.isfinite(torch.nn.utils.clip_grad_norm_(pupil.parameters(), 10.0)):
            optimizer.step()
            average.update(pupil.network)
        else:
            print(f"step {first_step + number}: the gradient is not finite, step left out", file=sys.stderr, flush=True)
        sums += losses.detach().numpy()
        count += 1
    return sums / count


def save_checkpoint(path, **values):
    """A reader or a killed run sees the old file or the new one, never a part."""
    partial = path.with_suffix(".partial")
    torch.save(values, partial)
    os.replace(partial, path)


def append_log(path, row):
    is_new = not path.exists()
    with open(path, "a", newline="") as file:
        writer = csv.DictWriter(file, row.keys())
        if is_new:
            writer.writeheader()
        writer.writerow(row)


def claim(work):
    """Writes this process's number to work/pid and holds a lock on it until the returned file is closed.

    @throws RuntimeError if another run holds the folder
    """
    file = open(work / "pid", "a+")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        with file:
            file.seek(0)
            holder = file.read().strip()
        raise RuntimeError(f"{work} is in use by process {holder}: end it or choose another --work") from None
    file.truncate(0)
    file.write(f"{os.getpid()}\n")
    file.flush()
    return file


def train(config, data, work, teacher_network, threads):
    torch.manual_seed(config["seed"])
    torch.set_num_threads(threads)
    if not (work / "teacher.json").exists():
        write_boxes(data, teacher_network, work / "teacher.json")
    teacher, teacher_boxes = Teacher(teacher_network), json.loads((work / "teacher.json").read_text())
    records, held_out = (load_records(data, split, teacher_boxes) for split in ("train", "val"))
    training_set = TrainingSet(PictureStore(data, records, work / "train.rgb"), records, config["source_weights"],
                               AugmentOptions(**config["augment"]), config["seed"])
    held_out_store = PictureStore(data, held_out, work / "val.rgb")
    pupil = Pupil(make_model(config), TEACHER_LOGITS).to(memory_format=torch.channels_last)
    average = MovingAverage(pupil.network, config["average_decay"])
    optimizer = make_optimizer(pupil, config)
    first_epoch = 0
    checkpoint = work / "checkpoint.pt"
    if checkpoint.exists():
        state = torch.load(checkpoint)
        pupil.load_state_dict(state["pupil"])
        average.load(state["average"])
        optimizer.load_state_dict(state["optimizer"])
        first_epoch = state["epoch"] + 1
    steps_per_epoch = len(training_set) // config["batch"]
    for epoch in range(first_epoch, config["epochs"]):
        start, cpu_start = time.monotonic(), time.process_time()
        size = input_size(config, epoch)
        training_set.set_epoch(epoch, size, epoch < config["epochs"] - config["epochs_without_mosaics"])
        # One process prepares the samples; items are independent, so their order does not matter.
        loader = torch.utils.data.DataLoader(training_set, config["batch"], num_workers=1, drop_last=True,
                                             collate_fn=collate)
        losses = train_epoch(pupil, teacher, average, optimizer, loader, size, config, epoch * steps_per_epoch,
                             config["epochs"] * steps_per_epoch)
        row = {"epoch": epoch, "input_size": size, "seconds": round(time.monotonic() - start, 1),
               "cpu_seconds": round(time.process_time() - cpu_start, 1),
               **{f"{name}_loss": round(float(value), 4)
                  for name, value in zip(("classification", "box", "distribution", "distillation"), losses)}}
        last = epoch + 1 == config["epochs"]
        human = targets = None
        if last or (epoch + 1) % config["validate_every"] == 0:
            human, targets = validate(average.model, held_out_store, held_out, size)
        for label, name in enumerate(CLASSES):
            for truth, results in (("human", human), ("targets", targets)):
                # Empty: not validated in this epoch, or no such box in the split.
                judged = results and results[label][1]
                row[f"ap_{truth}_{name}"] = round(results[label][0], 4) if judged else ""
        save_checkpoint(checkpoint, pupil=pupil.state_dict(), average=average.state(),
                        optimizer=optimizer.state_dict(), epoch=epoch, config=config)
        append_log(work / "log.csv", row)
        print({key: value for key, value in row.items() if value != ""}, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of labels.json")
    parser.add_argument("--work", type=Path, required=True, help="folder for checkpoints, logs and decoded pictures")
    parser.add_argument("--teacher", type=Path, required=True, help="YOLOX-nano, ONNX")
    parser.add_argument("--config", type=Path, default=Path(__file__).with_name("training.json"))
    parser.add_argument("--threads", type=int, default=2, help="threads of the network; samples take one more process")
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    config = json.loads(arguments.config.read_text())
    with claim(arguments.work):
        (arguments.work / "training.json").write_text(json.dumps(config, indent=2) + "\n")
        train(config, arguments.data, arguments.work, arguments.teacher, arguments.threads)


if __name__ == "__main__":
    main()
