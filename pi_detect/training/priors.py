"""Prior boxes of the SSD (Liu et al. 2016, section 2.2), as a function of a few numbers stored beside the network."""

from dataclasses import asdict, dataclass, field

import numpy as np


@dataclass(frozen=True)
class PriorLayout:
    """Describes all priors of a square network input.

    The map of stride s has ceil(input_size / s) rows and columns; every cell carries, for each size and, inside it,
    each aspect ratio, one prior centred in the cell: size * s * sqrt(ratio) pixels wide, size * s / sqrt(ratio) high.
    Sizes in strides rather than in fractions of the picture let one head serve every map and every input size.
    """

    input_size: int = 288                                 # pixels
    strides: tuple = (8, 16, 32, 64, 128)                 # pixels, finest map first
    sizes: tuple = (1.5, 2.1213)                          # in strides, half an octave apart
    aspect_ratios: tuple = (0.32, 0.7, 1.4)               # width / height
    variances: tuple = field(default=(0.1, 0.2))          # of centre and size, as in SSD's code

    def __post_init__(self):
        if self.input_size < 32 or self.input_size % 32:
            raise ValueError(f"input_size = {self.input_size}, must be a positive multiple of 32")

    @property
    def priors_per_cell(self):
        return len(self.sizes) * len(self.aspect_ratios)

    def boxes(self):
        """All priors as float32 rows (centre x, centre y, width, height) in fractions of the input, unclipped.

        Order: map (finest first), row, column, size, aspect ratio; the order of the network's outputs.
        """
        maps = []
        for stride in self.strides:
            cells = -(-self.input_size // stride)
            # The centre of cell i lies at (i + 0.5) * stride pixels also where the last cell exceeds the input.
            centres = (np.arange(cells) + 0.5) * stride / self.input_size
            shapes = [(size * stride * ratio ** 0.5 / self.input_size, size * stride / ratio ** 0.5 / self.input_size)
                      for size in self.sizes for ratio in self.aspect_ratios]
            grid = np.empty((cells, cells, len(shapes), 4))
            grid[..., 0] = centres[None, :, None]
            grid[..., 1] = centres[:, None, None]
            grid[..., 2:] = np.asarray(shapes)
            maps.append(grid.reshape(-1, 4))
        return np.concatenate(maps).astype(np.float32)

    def to_dict(self):
        """Plain lists and numbers, ready for JSON or YAML; PriorLayout.from_dict() is the inverse."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    @staticmethod
    def from_dict(values):
        return PriorLayout(**{key: tuple(value) if isinstance(value, list) else value
                              for key, value in values.items()})
