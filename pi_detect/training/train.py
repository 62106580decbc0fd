#!/usr/bin/python3
"""Trains the small SSD on the CPU; goes on from the last finished epoch when it is started again.

  train.py --data FOLDER --work FOLDER [--config training.json] [--threads 1]

Writes to the work folder: pid, checkpoint.pt (after every epoch, atomically), log.csv (one line an epoch), the decoded
pictures (train.rgb, val.rgb) and the configuration of the run.
"""

import argparse
import copy
import csv
import fcntl
import functools
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
from box_coding import decode, select_detections
from dataset import TrainingSet, normalise
from label_set import CLASSES, PictureStore, human_truth, load_records, target_truth
from losses import detection_loss
from model import SmallSsd
from pi_detect.average_precision import evaluate
from priors import PriorLayout


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


def make_layout(config, size):
    return PriorLayout.from_dict({**config["priors"], "input_size": size})


def make_model(config):
    layout = make_layout(config, 32)
    return SmallSsd(len(CLASSES), layout.priors_per_cell, **config["network"])


def make_optimizer(model, config):
    """AdamW (Loshchilov and Hutter 2019); biases and batch-norm weights do not decay."""
    decayed = [p for p in model.parameters() if p.dim() > 1]
    plain = [p for p in model.parameters() if p.dim() <= 1]
    return torch.optim.AdamW([{"params": decayed, "weight_decay": config["weight_decay"]},
                              {"params": plain, "weight_decay": 0.0}], lr=config["learning_rate"])


@functools.lru_cache(maxsize=None)
def has_fast_bfloat16():
    """Whether the CPU multiplies bfloat16 in hardware; where it does not, bfloat16 takes ten times as long as float32."""
    flags = Path("/proc/cpuinfo").read_text()
    return "avx512_bf16" in flags or "amx_bf16" in flags


def autocast():
    return torch.autocast("cpu", dtype=torch.bfloat16, enabled=has_fast_bfloat16())


@torch.no_grad()
def detect(model, layout, pictures):
    """Detections of single pictures (arrays S x S x 3), rows [class, score, x1, y1, x2, y2] in 0..1, per picture."""
    priors = layout.boxes()
    results = []
    for start in range(0, len(pictures), 16):
        batch = torch.from_numpy(np.stack(pictures[start:start + 16]).transpose(0, 3, 1, 2))
        with autocast():
            codes, logits = model(normalise(batch))
        scores = torch.sigmoid(logits.float()).numpy()
        results += [select_detections(box, score)
                    for box, score in zip(decode(codes.float().numpy(), priors, layout.variances), scores)]
    return results


def validate(model, layout, store, records):
    """Average precision per class, against people's boxes and against the training targets of the split."""
    detections = detect(model, layout, [stretch(store.image(record), layout.input_size) for record in records])
    for rows, record in zip(detections, records):
        rows[:, 2:] *= np.asarray([record.width, record.height] * 2)
    return (evaluate(detections, [human_truth(r) for r in records], len(CLASSES)),
            evaluate(detections, [target_truth(r) for r in records], len(CLASSES)))


def train_epoch(model, average, optimizer, loader, layout, config, first_step, steps):
    """One pass; returns the mean classification and box loss."""
    model.train()
    priors = torch.from_numpy(layout.boxes())
    sums, count = np.zeros(2), 0
    for number, (pixels, labels, scores, boxes) in enumerate(loader):
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(config, first_step + number, steps)
        with autocast():
            codes, logits = model(normalise(pixels))
        classification, box = detection_loss(codes.float(), logits.float(), labels, scores, boxes, priors,
                                             layout.variances)
        loss = classification + config["box_weight"] * box
        if not torch.isfinite(loss):
            raise FloatingPointError(f"the loss is {loss.item()} in step {first_step + number}: "
                                     "lower learning_rate and start again from the last checkpoint")
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        # PyTorch 1.13's bfloat16 gradient of a depthwise convolution with a 1 x 1 output is not a number now and then
        # (seen with inputs below 160 pixels): such a step is left out.
        if torch.isfinite(torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)):
            optimizer.step()
            average.update(model)
        else:
            print(f"step {first_step + number}: the gradient is not finite, step left out", file=sys.stderr, flush=True)
        sums += [classification.item(), box.item()]
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


def train(config, data, work, threads):
    torch.manual_seed(config["seed"])
    torch.set_num_threads(threads)
    records, held_out = load_records(data, "train"), load_records(data, "val")
    training_set = TrainingSet(PictureStore(data, records, work / "train.rgb"), records,
                               lambda size: make_layout(config, size), config["source_weights"],
                               AugmentOptions(**config["augment"]), config["seed"])
    held_out_store = PictureStore(data, held_out, work / "val.rgb")
    model = make_model(config).to(memory_format=torch.channels_last)
    average = MovingAverage(model, config["average_decay"])
    optimizer = make_optimizer(model, config)
    first_epoch = 0
    checkpoint = work / "checkpoint.pt"
    if checkpoint.exists():
        state = torch.load(checkpoint)
        model.load_state_dict(state["model"])
        average.load(state["average"])
        optimizer.load_state_dict(state["optimizer"])
        first_epoch = state["epoch"] + 1
    steps_per_epoch = len(training_set) // config["batch"]
    for epoch in range(first_epoch, config["epochs"]):
        start, cpu_start = time.monotonic(), time.process_time()
        layout = make_layout(config, input_size(config, epoch))
        training_set.set_epoch(epoch, layout.input_size)
        # One process prepares the samples; items are independent, so their order does not matter.
        loader = torch.utils.data.DataLoader(training_set, config["batch"], num_workers=1, drop_last=True)
        losses = train_epoch(model, average, optimizer, loader, layout, config, epoch * steps_per_epoch,
                             config["epochs"] * steps_per_epoch)
        row = {"epoch": epoch, "input_size": layout.input_size, "seconds": round(time.monotonic() - start, 1),
               "cpu_seconds": round(time.process_time() - cpu_start, 1),
               "classification_loss": round(losses[0], 4), "box_loss": round(losses[1], 4)}
        last = epoch + 1 == config["epochs"]
        human = targets = None
        if last or (epoch + 1) % config["validate_every"] == 0:
            human, targets = validate(average.model, layout, held_out_store, held_out)
        for label, name in enumerate(CLASSES):
            for truth, results in (("human", human), ("targets", targets)):
                # Empty: not validated in this epoch, or no such box in the split.
                judged = results and results[label][1]
                row[f"ap_{truth}_{name}"] = round(results[label][0], 4) if judged else ""
        save_checkpoint(checkpoint, model=model.state_dict(), average=average.state(),
                        optimizer=optimizer.state_dict(), epoch=epoch, config=config)
        append_log(work / "log.csv", row)
        print({key: value for key, value in row.items() if value != ""}, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of labels.json")
    parser.add_argument("--work", type=Path, required=True, help="folder for checkpoints, logs and decoded pictures")
    parser.add_argument("--config", type=Path, default=Path(__file__).with_name("training.json"))
    parser.add_argument("--threads", type=int, default=1, help="threads of the network; samples take one more process")
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    config = json.loads(arguments.config.read_text())
    with claim(arguments.work):
        (arguments.work / "training.json").write_text(json.dumps(config, indent=2) + "\n")
        train(config, arguments.data, arguments.work, arguments.threads)


if __name__ == "__main__":
    main()
