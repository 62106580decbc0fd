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

import losses
from cells import cells
from model import STRIDES, StreetNet

BINS = 8
NOTHING = torch.zeros(0, 4)


def sides_for(place, box):
    """Logits (cells x 4 x bins) whose boxes are the box, as far as the bins reach."""
    reach = (torch.cat([place[:, :2] - box[:2], box[2:] - place[:, :2]], 1) / place[:, 2:]).clamp(0, BINS - 1.001)
    low = reach.floor().long()
    logits = torch.full((len(place), 4, BINS), -30.0)
    logits.scatter_(2, low[..., None], torch.log(1 - reach + low)[..., None].clamp(min=-30))
    logits.scatter_(2, low[..., None] + 1, torch.log(reach - low)[..., None].clamp(min=-30))
    return logits


class Losses(unittest.TestCase):
    def setUp(self):
        self.place = torch.from_numpy(cells(96, STRIDES))

    def test_focal_loss_vanishes_at_its_target_and_grows_away_from_it(self):
        logits = torch.logit(torch.tensor([0.7, 0.5, 0.1]))
        values = losses.quality_focal_loss(logits, torch.full((3,), 0.7))
        self.assertAlmostEqual(values[0].item(), 0, places=6)
        self.assertLess(values[1].item(), values[2].item())

    def test_a_box_is_decoded_from_every_cell_that_can_reach_it(self):
        box = torch.tensor([20.0, 24.0, 60.0, 70.0])
        place = self.place[losses.inside(self.place[:, :2], box[None])[:, 0]]
        torch.testing.assert_close(losses.decode(sides_for(place, box), place), box.expand(len(place), 4), rtol=0,
                                   atol=1e-3)

    def test_generalised_iou_of_known_boxes(self):
        a = torch.tensor([[0.0, 0, 2, 2], [0, 0, 1, 1], [0, 0, 2, 2]])
        b = torch.tensor([[0.0, 0, 2, 2], [3, 0, 4, 1], [1, 0, 3, 2]])
        torch.testing.assert_close(losses.generalised_iou(a, b), torch.tensor([1.0, -0.5, 1 / 3]))

    def assign(self, boxes, classes, ignored=NOTHING, predicted=None):
        if predicted is None:
            predicted = torch.cat([self.place[:, :2] - 8, self.place[:, :2] + 8], 1)
        return losses.assign(torch.full((len(self.place), 2), 0.1), predicted, self.place, boxes, classes, ignored)

    def test_a_box_takes_cells_inside_it_and_the_best_one_has_its_overlap(self):
        box = torch.tensor([[16.0, 16.0, 64.0, 64.0]])
        matched, quality, counted = self.assign(box, torch.tensor([1]))
        positive = (matched == 0).nonzero()[:, 0]
        self.assertLessEqual(len(positive), losses.CANDIDATES)
        self.assertTrue(losses.inside(self.place[positive, :2], box).all())
        self.assertAlmostEqual(quality.max().item(), 16 * 16 / (48 * 48), places=5)
        self.assertTrue(counted.all())

    def test_a_box_between_the_cells_has_its_nearest_cell(self):
        matched, _, _ = self.assign(torch.tensor([[17.0, 17.0, 19.0, 19.0]]), torch.tensor([0]))
        self.assertEqual((matched == 0).sum().item(), 1)

    def test_boxes_that_a_new_network_misses_get_cells_all_the_same(self):
        away = torch.zeros(len(self.place), 4) - 50
        matched, quality, _ = self.assign(torch.tensor([[16.0, 16.0, 64.0, 64.0]]), torch.tensor([0]), predicted=away)
        self.assertGreater((matched == 0).sum().item(), 0)
        self.assertEqual(quality.max().item(), 0)

    def test_a_cell_of_two_boxes_goes_to_the_one_that_it_fits(self):
        boxes = torch.tensor([[0.0, 0.0, 96.0, 96.0], [30.0, 30.0, 46.0, 46.0]])
        matched, _, _ = self.assign(boxes, torch.tensor([0, 1]))
        nearest = (self.place[:, :2] - 38).norm(dim=1).argmin()
        self.assertEqual(matched[nearest].item(), 1)

    def test_ignored_regions_are_no_background_but_may_hold_a_box(self):
        whole = torch.tensor([[0.0, 0.0, 96.0, 96.0]])
        matched, _, counted = self.assign(torch.tensor([[16.0, 16.0, 64.0, 64.0]]), torch.tensor([0]), whole)
        self.assertGreater(counted.sum().item(), 0)
        torch.testing.assert_close(counted, matched >= 0)

    def test_right_outputs_cost_nothing_and_ignored_cells_have_no_gradient(self):
        box = torch.tensor([20.0, 24.0, 60.0, 70.0])
        logits = torch.full((len(self.place), 2), -20.0)
        sides = sides_for(self.place, box)
        sample = (box[None], torch.tensor([1]), torch.ones(1), torch.tensor([[80.0, 80.0, 96.0, 96.0]]))
        matched, quality, counted = losses.assign(torch.sigmoid(logits), losses.decode(sides, self.place), self.place,
                                                  *sample[:2], sample[3])
        logits[matched >= 0, 1] = torch.logit(quality[matched >= 0].clamp(1e-6, 1 - 1e-6))
        logits[~counted] = 5.0
        outputs = torch.cat([logits, sides.flatten(1)], 1)[None].requires_grad_()
        parts = losses.detection_loss(outputs, self.place, [sample], 2)
        self.assertLess(parts[0].item(), 0.05)
        self.assertAlmostEqual(parts[1].item(), 0, places=3)
        sum(parts).backward()
        self.assertTrue((~counted).any())
        self.assertEqual(outputs.grad[0, ~counted].abs().sum().item(), 0)

    def test_a_picture_without_boxes_is_background(self):
        outputs = torch.zeros(1, len(self.place), 2 + 4 * BINS, requires_grad=True)
        parts = losses.detection_loss(outputs, self.place, [(NOTHING, torch.zeros(0, dtype=torch.int64),
                                                             torch.zeros(0), NOTHING)], 2)
        sum(parts).backward()
        self.assertGreater(outputs.grad[0, :, :2].min().item(), 0)

    def test_distillation_asks_most_where_the_teacher_sees_something(self):
        teacher = torch.full((1, 2, 4), -5.0)
        teacher[0, 1] = 5.0
        seen, unseen = teacher.clone(), teacher.clone()
        seen[0, 1] += 1
        unseen[0, 0] += 1
        self.assertGreater(losses.distillation_loss(seen, teacher).item(),
                           5 * losses.distillation_loss(unseen, teacher).item())
        self.assertEqual(losses.distillation_loss(teacher, teacher).item(), 0)


class Network(unittest.TestCase):
    def test_outputs_match_the_cells_at_every_size(self):
        model = StreetNet(3, BINS, stem=(4, 8), channels=(8, 12, 16), blocks=(1, 1, 1), head_channels=8).eval()
        for size in (96, 160, 224, 256):
            self.assertEqual(tuple(model(torch.zeros(1, 3, size, size)).shape),
                             (1, len(cells(size, STRIDES)), 3 + 4 * BINS))

    def test_a_few_steps_learn_one_picture(self):
        torch.manual_seed(3)
        model = StreetNet(2, BINS, stem=(8, 8), channels=(8, 16, 16), blocks=(1, 1, 1), head_channels=16)
        place = torch.from_numpy(cells(64, STRIDES))
        picture = torch.zeros(2, 3, 64, 64)
        picture[:, :, 16:48, 16:48] = 1
        sample = (torch.tensor([[16.0, 16.0, 48.0, 48.0]]), torch.tensor([1]), torch.ones(1), NOTHING)
        optimizer = torch.optim.Adam(model.parameters(), 5e-3)
        for _ in range(60):
            outputs = model(picture)
            parts = losses.detection_loss(outputs, place, [sample] * 2, 2)
            optimizer.zero_grad()
            sum(parts).backward()
            optimizer.step()
        best = outputs[0, :, 1].argmax()
        found = losses.decode(outputs[0, :, 2:].unflatten(-1, (4, -1)), place)[best]
        self.assertGreater(losses.iou(found, sample[0][0]).item(), 0.8)


if __name__ == "__main__":
    unittest.main()
