"""Random training pictures: mosaics of four (Bochkovskiy et al. 2020), crops and zoom-out as SSD (Liu et al. 2016),
mirroring, colours."""

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageEnhance

import package_path  # noqa: F401  (leads to the next one)
from pi_detect.boxes import area

MIN_VISIBLE = 0.5      # a box keeps its label if at least this part of it is in the crop
MIN_REMAINDER = 0.1    # smaller remainders are forgotten, those between become ignored regions
MIN_PIXELS = 6.5       # boxes with a smaller sqrt(area) in the network input are ignored regions

RESAMPLING = (Image.Resampling.BILINEAR, Image.Resampling.BOX, Image.Resampling.BICUBIC)


@dataclass
class Sample:
    """A network input and its boxes; boxes in pixels of the input."""

    pixels: np.ndarray         # size x size x 3, uint8 RGB
    boxes: np.ndarray          # n x 4 corner boxes
    classes: np.ndarray        # n
    scores: np.ndarray         # n
    ignored_boxes: np.ndarray  # m x 4


@dataclass(frozen=True)
class AugmentOptions:
    mosaic: float = 0.6        # probability of four pictures in one
    min_scale: float = 0.3     # of a picture in a mosaic; 1: as large as the input
    max_scale: float = 1.7
    crop: float = 0.5          # else: of a zoom-in,
    expand: float = 0.25       # of a zoom-out; the rest are whole pictures
    min_crop_area: float = 0.15
    max_expand: float = 2.5    # side of the zoomed-out canvas in picture sides
    grey: float = 0.05         # probability of a colourless picture
    noise: float = 0.15        # probability of added sensor noise


def stretch(image, size):
    """The whole picture stretched to size x size pixels, bilinear without low-pass, as OpenCV's blobFromImage does."""
    return np.asarray(image.transform((size, size), Image.Transform.EXTENT, (0, 0) + image.size,
                                      Image.Resampling.BILINEAR))


def _resize(rng, image, source, width, height):
    """Cuts the rectangle source (pixels, inside the picture) and scales it, with one of several low-pass qualities."""
    if rng.random() < 0.5:
        return image.transform((width, height), Image.Transform.EXTENT, source, Image.Resampling.BILINEAR)
    return image.resize((width, height), RESAMPLING[rng.integers(len(RESAMPLING))], source)


def random_crop(rng, record, draw_size):
    """A rectangle inside the picture that shows the centre of a box, where the picture has boxes.

    @param draw_size  function that draws width and height of the rectangle in parts of the picture's
    """
    crop = (0.0, 0.0, float(record.width), float(record.height))
    for _ in range(20):
        width, height = (side * min(part, 1.0) for side, part in zip((record.width, record.height), draw_size()))
        left = rng.uniform(0, record.width - width)
        top = rng.uniform(0, record.height - height)
        crop = (left, top, left + width, top + height)
        if not len(record.boxes):
            break
        centres = (record.boxes[:, :2] + record.boxes[:, 2:]) / 2
        if np.any((centres > crop[:2]).all(1) & (centres < crop[2:]).all(1)):
            break
    return crop


def place_boxes(boxes, source, target):
    """Corner boxes under the map of the rectangle source onto the rectangle target, cut to target, and for each box the
    part of its area that remains."""
    source = np.asarray(source)
    target = np.asarray(target)
    scale = (target[2:] - target[:2]) / (source[2:] - source[:2])
    moved = (boxes - np.tile(source[:2], 2)) * np.tile(scale, 2) + np.tile(target[:2], 2)
    cut = np.clip(moved, np.tile(target[:2], 2), np.tile(target[2:], 2))
    return cut.astype(np.float32), area(cut) / np.maximum(area(moved), 1e-9)


def paste(rng, canvas, store, record, source, target):
    """Draws the part source of the record's picture onto the integer rectangle target of the canvas.

    @return Sample of the pasted part alone (pixels: the canvas)
    """
    width, height = int(target[2] - target[0]), int(target[3] - target[1])
    picture = _resize(rng, store.image(record), tuple(source), width, height)
    canvas[target[1]:target[3], target[0]:target[2]] = np.asarray(picture)
    boxes, visible = place_boxes(record.boxes, source, target)
    ignored, ignored_visible = place_boxes(record.ignored_boxes, source, target)
    kept = (visible >= MIN_VISIBLE) & (np.sqrt(area(boxes)) >= MIN_PIXELS)
    cut_away = ~kept & (visible >= MIN_REMAINDER)
    return Sample(canvas, boxes[kept], record.classes[kept], record.scores[kept],
                  np.concatenate([ignored[ignored_visible > 0], boxes[cut_away]]))


def place_in_tile(rng, record, tile, size, options):
    """A random crop of the picture and the part of the tile (integer rectangle) that it fills at a random scale."""
    scale = np.exp(rng.uniform(np.log(options.min_scale), np.log(options.max_scale)))
    ratio = np.exp(rng.uniform(-0.25, 0.25))
    full = size * scale * ratio, size * scale / ratio  # pixels of the whole picture
    side = tile[2] - tile[0], tile[3] - tile[1]
    source = random_crop(rng, record, lambda: (side[0] / full[0], side[1] / full[1]))
    width, height = (max(1, min(s, round(f))) for s, f in zip(side, full))
    left, top = tile[0] + rng.integers(side[0] - width + 1), tile[1] + rng.integers(side[1] - height + 1)
    return source, (left, top, left + width, top + height)


def mosaic(rng, store, records, size, options):
    """Four pictures around a random centre."""
    canvas = np.empty((size, size, 3), np.uint8)
    canvas[:] = rng.integers(60, 190, 3, dtype=np.uint8)
    x, y = (int(rng.uniform(0.3, 0.7) * size) for _ in range(2))
    tiles = [(0, 0, x, y), (x, 0, size, y), (0, y, x, size), (x, y, size, size)]
    parts = [paste(rng, canvas, store, record, *place_in_tile(rng, record, tile, size, options))
             for record, tile in zip(records, tiles)]
    return Sample(canvas, *[np.concatenate([getattr(part, name) for part in parts])
                            for name in ("boxes", "classes", "scores", "ignored_boxes")])


def zoom(rng, store, record, size, options):
    """A crop, a smaller copy on a plain canvas, or the whole picture."""
    canvas = np.empty((size, size, 3), np.uint8)
    source, target = (0.0, 0.0, float(record.width), float(record.height)), (0, 0, size, size)
    choice = rng.random()
    if choice < options.crop:
        def draw_size():
            side, ratio = np.sqrt(rng.uniform(options.min_crop_area, 1.0)), np.exp(rng.uniform(-0.25, 0.25))
            return side * ratio, side / ratio
        source = random_crop(rng, record, draw_size)
    elif choice < options.crop + options.expand:
        canvas[:] = rng.integers(60, 190, 3, dtype=np.uint8)
        side = rng.uniform(1.0, options.max_expand)
        width, height = (int(size / side * np.exp(rng.uniform(-0.15, 0.15))) for _ in range(2))
        width, height = min(width, size), min(height, size)
        left, top = rng.integers(size - width + 1), rng.integers(size - height + 1)
        target = (left, top, left + width, top + height)
    return paste(rng, canvas, store, record, source, target)


def mirror(sample):
    """Swaps left and right."""
    size = sample.pixels.shape[1]
    flip = lambda boxes: np.stack([size - boxes[:, 2], boxes[:, 1], size - boxes[:, 0], boxes[:, 3]], 1)
    return Sample(sample.pixels[:, ::-1], flip(sample.boxes), sample.classes, sample.scores,
                  flip(sample.ignored_boxes))


def colours(rng, pixels, options):
    """Gamma, contrast, brightness and white balance as one table per channel, then saturation; sometimes noise."""
    levels = np.linspace(0, 1, 256) ** np.exp(rng.uniform(-0.35, 0.35))
    levels = (levels - 0.5) * rng.uniform(0.7, 1.3) + 0.5 + rng.uniform(-0.12, 0.12)
    tables = np.clip(levels[None] * np.exp(rng.uniform(-0.12, 0.12, (3, 1))) * 255, 0, 255).astype(np.uint8)
    saturation = 0.0 if rng.random() < options.grey else rng.uniform(0.5, 1.5)
    image = Image.fromarray(np.ascontiguousarray(pixels)).point(tables.ravel().tolist())
    result = np.asarray(ImageEnhance.Color(image).enhance(saturation))
    if rng.random() < options.noise:
        noise = rng.standard_normal(result.shape, np.float32) * np.float32(rng.uniform(2, 12))
        result = np.clip(result + noise, 0, 255).astype(np.uint8)
    return result


def random_sample(rng, store, records, choose, size, options):
    """One random training picture of size x size pixels.

    @param choose  function that draws an index into records with the generator rng
    """
    if rng.random() < options.mosaic:
        sample = mosaic(rng, store, [records[choose(rng)] for _ in range(4)], size, options)
    else:
        sample = zoom(rng, store, records[choose(rng)], size, options)
    if rng.random() < 0.5:
        sample = mirror(sample)
    sample.pixels = colours(rng, sample.pixels, options)
    return sample
