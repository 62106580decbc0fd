#!/usr/bin/python3
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

try:
    import torch
except ImportError:
    raise unittest.SkipTest("PyTorch is not installed (Debian: python3-torch)")

import box_coding
import losses
from model import SmallSsd
from priors import PriorLayout


class Losses(unittest.TestCase):
    def test_focal_loss_vanishes_at_its_target_and_grows_away_from_it(self):
        logits = torch.logit(torch.tensor([0.7, 0.5, 0.1]))
        values = losses.quality_focal_loss(logits, torch.full((3,), 0.7))
        self.assertAlmostEqual(values[0].item(), 0, places=6)
        self.assertLess(values[1].item(), values[2].item())

    def test_decode_agrees_with_numpy(self):
        rng = np.random.default_rng(1)
        layout = PriorLayout(input_size=64)
        codes = rng.normal(0, 1, (2, len(layout.boxes()), 4)).astype(np.float32)
        expected = box_coding.decode(codes, layout.boxes(), layout.variances)
        actual = losses.decode(torch.from_numpy(codes), torch.from_numpy(layout.boxes()), layout.variances)
        np.testing.assert_allclose(actual.numpy(), expected, rtol=1e-5, atol=1e-6)

    def test_generalised_iou_of_known_boxes(self):
        a = torch.tensor([[0.0, 0, 2, 2], [0, 0, 1, 1], [0, 0, 2, 2]])
        b = torch.tensor([[0.0, 0, 2, 2], [3, 0, 4, 1], [1, 0, 3, 2]])
        expected = torch.tensor([1.0, -0.5, 1 / 3])
        torch.testing.assert_close(losses.generalised_iou(a, b), expected)

    def test_ignored_priors_have_no_gradient(self):
        layout = PriorLayout(input_size=64)
        count = len(layout.boxes())
        logits = torch.zeros(1, count, 3, requires_grad=True)
        labels = torch.full((1, count), box_coding.BACKGROUND)
        labels[0, 0], labels[0, 1] = 1, box_coding.IGNORED
        boxes = torch.from_numpy(box_coding.to_corners(layout.boxes()))[None]
        parts = losses.detection_loss(torch.zeros(1, count, 4), logits, labels, torch.ones(1, count), boxes,
                                      torch.from_numpy(layout.boxes()), layout.variances)
        parts[0].backward()
        self.assertEqual(logits.grad[0, 1].abs().sum().item(), 0)
        self.assertLess(logits.grad[0, 0, 1].item(), 0)
        self.assertGreater(logits.grad[0, 2].min().item(), 0)
        self.assertAlmostEqual(parts[1].item(), 0, places=5)


class Network(unittest.TestCase):
    def test_outputs_match_the_priors_at_every_size(self):
        model = SmallSsd(3, PriorLayout().priors_per_cell, stem=(4, 8), channels=(8, 12, 16), blocks=(1, 1, 1),
                         head_channels=8).eval()
        for size in (96, 160, 192, 256, 288):
            codes, logits = model(torch.zeros(1, 3, size, size))
            count = len(PriorLayout(input_size=size).boxes())
            self.assertEqual((tuple(codes.shape), tuple(logits.shape)), ((1, count, 4), (1, count, 3)))

    def test_a_few_steps_learn_one_picture(self):
        torch.manual_seed(3)
        layout = PriorLayout(input_size=64)
        model = SmallSsd(2, layout.priors_per_cell, stem=(8, 8), channels=(8, 16, 16), blocks=(1, 1, 1),
                         head_channels=16)
        picture = torch.zeros(2, 3, 64, 64)
        picture[:, :, 16:48, 16:48] = 1
        box = np.asarray([[0.25, 0.25, 0.75, 0.75]], np.float32)
        labels, matched = box_coding.match(box_coding.to_corners(layout.boxes()), box, np.asarray([1]),
                                           np.zeros((0, 4)))
        labels = torch.from_numpy(np.stack([labels] * 2))
        boxes = torch.from_numpy(np.stack([box[np.maximum(matched, 0)]] * 2))
        optimizer = torch.optim.Adam(model.parameters(), 5e-3)
        priors = torch.from_numpy(layout.boxes())
        history = []
        for _ in range(40):
            codes, logits = model(picture)
            parts = losses.detection_loss(codes, logits, labels, torch.ones(labels.shape), boxes, priors,
                                          layout.variances)
            optimizer.zero_grad()
            sum(parts).backward()
            optimizer.step()
            history.append(sum(parts).item())
        self.assertLess(history[-1], 0.3 * history[0])


if __name__ == "__main__":
    unittest.main()
