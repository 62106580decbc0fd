"""Training losses of the SSD: focal classification with soft targets and generalised IoU of the boxes."""

import torch
import torch.nn.functional as F

from box_coding import IGNORED


def quality_focal_loss(logits, targets, gamma=2.0):
    """Focal loss for targets in 0..1, not only 0 and 1: |t - p|^gamma times the cross entropy (Li et al. 2020, eq. 5).

    A teacher's box trains towards the teacher's score, a person's box towards 1. Returns elementwise losses.
    """
    probability = torch.sigmoid(logits)
    entropy = F.binary_cross_entropy_with_logits(logits, targets, reduction="none")
    return (targets - probability).abs().pow(gamma) * entropy


def decode(codes, priors, variances):
    """box_coding.decode() for tensors."""
    centre = priors[..., :2] + codes[..., :2] * variances[0] * priors[..., 2:]
    half = priors[..., 2:] * torch.exp((codes[..., 2:] * variances[1]).clamp(max=4.0)) / 2
    return torch.cat([centre - half, centre + half], -1)


def generalised_iou(a, b):
    """GIoU of corner boxes row by row (Rezatofighi et al. 2019), in -1..1."""
    common = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0).prod(1)
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(1)
    union = (a[:, 2:] - a[:, :2]).prod(1) + (b[:, 2:] - b[:, :2]).prod(1) - common
    return common / union.clamp(min=1e-9) - (hull - union) / hull.clamp(min=1e-9)


def detection_loss(codes, logits, labels, scores, boxes, priors, variances):
    """Classification and box loss of a batch, both divided by the number of matched priors.

    @param codes, logits          network outputs, n x p x 4 and n x p x classes
    @param labels, scores, boxes  targets of dataset.TrainingSet, n x p, n x p, n x p x 4
    @param priors                 centre boxes, p x 4
    @return (classification loss, box loss)
    """
    positive = labels >= 0
    count = positive.sum().clamp(min=1).float()
    targets = torch.zeros_like(logits)
    image, prior = positive.nonzero(as_tuple=True)
    targets[image, prior, labels[image, prior]] = scores[image, prior]
    counted = labels != IGNORED
    classification = quality_focal_loss(logits[counted], targets[counted]).sum() / count
    predicted = decode(codes[positive], priors[prior], variances)
    box = (1 - generalised_iou(predicted, boxes[positive])).sum() / count
    return classification, box
