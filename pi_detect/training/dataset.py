"""PyTorch data set of random training samples; every item depends only on (seed, epoch, index)."""

import dataclasses

import numpy as np
import torch

import augment


class TrainingSet(torch.utils.data.Dataset):
    """Items: (picture 3 x S x S uint8, (corner boxes [px], classes, scores, ignored boxes [px])), as tensors.

    Sources are drawn with source_weights (default 1), so that an epoch has as many items as the set has pictures
    whatever the mix. set_epoch() chooses the random numbers, the input size and whether there are mosaics; call it
    before the epoch's loader starts.
    """

    def __init__(self, store, records, source_weights, options, seed):
        self._store = store
        self._records = records
        self._options = options
        self._seed = seed
        weights = np.asarray([source_weights.get(record.source, 1.0) for record in records])
        self._cumulative = np.cumsum(weights) / weights.sum()
        self._epoch, self._size, self._epoch_options = 0, 0, options

    def set_epoch(self, epoch, size, with_mosaics=True):
        self._epoch, self._size = epoch, size
        self._epoch_options = self._options if with_mosaics else dataclasses.replace(self._options, mosaic=0.0)

    def __len__(self):
        return len(self._records)

    def _choose(self, rng):
        return min(int(np.searchsorted(self._cumulative, rng.random(), side="right")), len(self._records) - 1)

    def __getitem__(self, index):
        rng = np.random.default_rng([self._seed, self._epoch, index])
        sample = augment.random_sample(rng, self._store, self._records, self._choose, self._size, self._epoch_options)
        truth = (sample.boxes, sample.classes, sample.scores, sample.ignored_boxes)
        pixels = np.ascontiguousarray(sample.pixels.transpose(2, 0, 1))
        return torch.from_numpy(pixels), tuple(torch.from_numpy(np.ascontiguousarray(values)) for values in truth)


def collate(items):
    """A batch: (pictures, list of truths)."""
    return torch.stack([pixels for pixels, _ in items]), [truth for _, truth in items]


def normalise(pixels):
    """uint8 pictures to the network's input range -1..1, stored channels last (faster in the CPU convolutions)."""
    return ((pixels.float() - 127.5) / 127.5).contiguous(memory_format=torch.channels_last)
