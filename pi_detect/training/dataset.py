"""PyTorch data set of random training samples with their targets; every item depends only on (seed, epoch, index)."""

import numpy as np
import torch

import augment
import box_coding


class TrainingSet(torch.utils.data.Dataset):
    """Items: (picture 3 x S x S uint8, class per prior, target score per prior, corner box per prior in 0..1).

    Sources are drawn with source_weights (default 1), so that an epoch has as many items as the set has pictures
    whatever the mix. set_epoch() chooses the random numbers and the input size; call it before the epoch's loader
    starts.
    """

    def __init__(self, store, records, layout_of_size, source_weights, options, seed):
        self._store = store
        self._records = records
        self._layout_of_size = layout_of_size
        self._options = options
        self._seed = seed
        weights = np.asarray([source_weights.get(record.source, 1.0) for record in records])
        self._cumulative = np.cumsum(weights) / weights.sum()
        self._epoch = 0
        self._size = 0
        self._priors = np.zeros((0, 4), np.float32)

    def set_epoch(self, epoch, size):
        self._epoch = epoch
        self._size = size
        self._priors = box_coding.to_corners(self._layout_of_size(size).boxes())

    def __len__(self):
        return len(self._records)

    def _choose(self, rng):
        return min(int(np.searchsorted(self._cumulative, rng.random(), side="right")), len(self._records) - 1)

    def __getitem__(self, index):
        rng = np.random.default_rng([self._seed, self._epoch, index])
        sample = augment.random_sample(rng, self._store, self._records, self._choose, self._size, self._options)
        boxes = sample.boxes / self._size
        labels, matched = box_coding.match(self._priors, boxes, sample.classes, sample.ignored_boxes / self._size)
        positive = matched >= 0
        targets = np.zeros((len(self._priors), 4), np.float32)
        scores = np.zeros(len(self._priors), np.float32)
        targets[positive] = boxes[matched[positive]]
        scores[positive] = sample.scores[matched[positive]]
        pixels = np.ascontiguousarray(sample.pixels.transpose(2, 0, 1))
        return torch.from_numpy(pixels), torch.from_numpy(labels), torch.from_numpy(scores), torch.from_numpy(targets)


def normalise(pixels):
    """uint8 pictures to the network's input range -1..1, stored channels last (faster in the CPU convolutions)."""
    return ((pixels.float() - 127.5) / 127.5).contiguous(memory_format=torch.channels_last)
