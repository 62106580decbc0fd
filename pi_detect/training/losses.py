"""Assignment of boxes to cells and the losses of the street network.

Task-aligned assignment (Feng et al. 2021, TOOD), quality focal and distribution focal loss (Li et al. 2020),
generalised IoU (Rezatofighi et al. 2019).
"""

import torch
import torch.nn.functional as F

CANDIDATES = 10  # cells of a box, at most
SCORE_POWER, OVERLAP_POWER = 0.5, 4.0  # of the alignment of a cell with a box
LEAST_LOGIT = -8.0  # of the teacher: a probability of 1 / 3000


def quality_focal_loss(logits, targets, gamma=2.0):
    """Focal loss for targets in 0..1, not only 0 and 1: |t - p|^gamma times the cross entropy (Li et al. 2020, eq. 5).
    Returns elementwise losses."""
    probability = torch.sigmoid(logits)
    entropy = F.binary_cross_entropy_with_logits(logits, targets, reduction="none")
    return (targets - probability).abs().pow(gamma) * entropy


def distances(logits):
    """Expectation of the distributions (... x 4 x bins) over distances 0 .. bins - 1, in strides."""
    return logits.softmax(-1) @ torch.arange(logits.shape[-1], dtype=logits.dtype)


def decode(logits, cells):
    """Corner boxes [px of the input] of distributions (... x cells x 4 x bins)."""
    reach = distances(logits) * cells[:, 2:]
    return torch.cat([cells[:, :2] - reach[..., :2], cells[:, :2] + reach[..., 2:]], -1)


def _parts(a, b):
    """Common area, union, and corner boxes of the hulls of corner boxes that broadcast."""
    common = (torch.minimum(a[..., 2:], b[..., 2:]) - torch.maximum(a[..., :2], b[..., :2])).clamp(min=0).prod(-1)
    hull = torch.maximum(a[..., 2:], b[..., 2:]) - torch.minimum(a[..., :2], b[..., :2])
    union = (a[..., 2:] - a[..., :2]).prod(-1) + (b[..., 2:] - b[..., :2]).prod(-1) - common
    return common, union.clamp(min=1e-9), hull.prod(-1).clamp(min=1e-9)


def iou(a, b):
    """IoU of corner boxes that broadcast."""
    common, union, _ = _parts(a, b)
    return common / union


def generalised_iou(a, b):
    """GIoU of corner boxes row by row, in -1..1."""
    common, union, hull = _parts(a, b)
    return common / union - (hull - union) / hull


def inside(points, boxes):
    """n x m: whether each of n points lies in each of m boxes."""
    return ((points[:, None] > boxes[None, :, :2]) & (points[:, None] < boxes[None, :, 2:])).all(-1)


@torch.no_grad()
def assign(probabilities, predicted, cells, boxes, classes, ignored):
    """The box of each cell of one picture (task-aligned assignment).

    @param probabilities, predicted  of the network: cells x classes, cells x 4
    @param boxes, classes            n x 4 and n
    @param ignored                   m x 4 regions with content unknown
    @return (index of the box or -1, quality of the cell in 0..1, whether the cell counts as background or box)

    A box takes, of the cells whose points lie in it, those that fit its class and place best; the nearest cell of the
    finest map also belongs to it. Its best cell has the quality of that cell's overlap, the others less.
    """
    points = cells[:, :2]
    counted = ~inside(points, ignored).any(1)
    matched = torch.full((len(cells),), -1, dtype=torch.int64)
    quality = torch.zeros(len(cells))
    if not len(boxes):
        return matched, quality, counted
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2
    within = inside(points, boxes)
    finest = cells[:, 2] == cells[0, 2]
    nearest = torch.cdist(points[finest], centres).argmin(0)
    within[nearest, torch.arange(len(boxes))] = True
    overlap = iou(predicted[:, None], boxes[None]) * within
    # The small constant orders a new network's cells, all of which miss, by their distance to the centre.
    near = 1 / (1 + torch.cdist(points, centres) / cells[:, 2:])
    alignment = probabilities[:, classes].pow(SCORE_POWER) * overlap.pow(OVERLAP_POWER) + 1e-9 * near
    alignment = alignment * within
    least = alignment.topk(min(CANDIDATES, len(cells)), 0).values[-1]
    alignment = alignment * (alignment >= least)
    best, box = alignment.max(1)
    positive = best > 0
    matched[positive] = box[positive]
    highest = alignment.max(0).values.clamp(min=1e-12)
    reached = (overlap * (alignment > 0)).max(0).values
    quality[positive] = (best / highest[box] * reached[box])[positive]
    return matched, quality, counted | positive


def detection_loss(outputs, cells, samples, classes):
    """Losses of a batch, each divided by the sum of the target scores.

    @param outputs  of the network, n x cells x (classes + 4 bins)
    @param cells    cells.cells() as tensor
    @param samples  n tuples (boxes, classes, scores, ignored boxes) of tensors
    @return (classification, GIoU, distribution)
    """
    logits, sides = outputs[..., :classes], outputs[..., classes:].unflatten(-1, (4, -1))
    predicted = decode(sides, cells)
    targets, counted = torch.zeros_like(logits), torch.ones(logits.shape[:2], dtype=torch.bool)
    truth, weight = torch.zeros_like(predicted), torch.zeros(logits.shape[:2])
    probabilities = torch.sigmoid(logits.detach())
    for i, (boxes, labels, scores, ignored) in enumerate(samples):
        matched, quality, counted[i] = assign(probabilities[i], predicted[i].detach(), cells, boxes, labels, ignored)
        positive = (matched >= 0).nonzero()[:, 0]
        box = matched[positive]
        truth[i, positive] = boxes[box]
        weight[i, positive] = quality[positive] * scores[box]
        targets[i, positive, labels[box]] = weight[i, positive]
    total = weight.sum().clamp(min=1.0)
    classification = (quality_focal_loss(logits, targets) * counted[..., None]).sum() / total
    positive = weight > 0
    weight, truth, picked = weight[positive], truth[positive], sides[positive]
    cell = cells.expand(len(outputs), -1, -1)[positive]
    box = ((1 - generalised_iou(predicted[positive], truth)) * weight).sum() / total
    reach = torch.cat([cell[:, :2] - truth[:, :2], truth[:, 2:] - cell[:, :2]], 1) / cell[:, 2:]
    reach = reach.clamp(0, picked.shape[-1] - 1.01)
    low = reach.floor()
    log_probability = F.log_softmax(picked, -1)
    at = lambda index: log_probability.gather(-1, index.long().unsqueeze(-1)).squeeze(-1)
    entropy = -(at(low) * (low + 1 - reach) + at(low + 1) * (reach - low))
    return classification, box, (entropy.mean(1) * weight).sum() / total


def distillation_loss(logits, teacher_logits):
    """Squared error of a helper's logits to the teacher's (n x cells x (classes + objectness)), averaged over cells.

    Cells in which the teacher sees something weigh up to ten times as much as others. Below LEAST_LOGIT, certain
    "nothing", differences do not count.
    """
    certainty = torch.sigmoid(teacher_logits[..., -1]) * torch.sigmoid(teacher_logits[..., :-1]).amax(-1)
    weight = 0.1 + certainty
    error = (logits - teacher_logits.clamp(min=LEAST_LOGIT)).pow(2).mean(-1)
    return (error * weight).sum() / weight.sum()
