"""How good the centres of light of `gse extract --sub-pixel` are.

    python benchmarks/centroids.py [--images 4]

30 stars of one brightness on a level of 200 with white noise of 3 index values: the error on each axis against
signal-to-noise, width of the star and bits of the picture, beside the bound of Cramer and Rao, sqrt(2) width / S/N.
Signal-to-noise is that of a matched filter: light / (noise sqrt(4 pi) width).
"""

import argparse
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from gse.imaging.extraction import extract, extract_sub_pixel

STARS = 30
LEVEL = 200.0
NOISE = 3.0
RATIOS = (15, 20, 30, 50, 100, 200)
WIDTHS_PX = (0.5, 0.8, 1.2, 1.8, 2.5)
BITS = (12, 10, 8)
FOUND_WITHIN_PX = 2.0


class Case(NamedTuple):
    """Stars of one kind: S/N, width (1 sigma, px), and the bits of the picture."""

    ratio: float
    width_px: float
    bits: int


def image_of(case: Case, random: np.random.Generator) -> tuple[NDArray[np.uint16], NDArray[np.float64]]:
    """An image of 480 x 480 in steps of its bits, and the pixels (30, 2) of its stars, each in a row of its own."""
    rows = 15 + 15 * random.permutation(STARS) + random.uniform(-0.5, 0.5, STARS)
    xy_px = np.column_stack([20 + 15 * np.arange(STARS) + random.uniform(-0.5, 0.5, STARS), rows])
    edges = (np.arange(481) - 0.5 - xy_px.T[..., None]) / case.width_px / math.sqrt(2)
    across, down = np.diff(erf(edges)) / 2
    light = case.ratio * NOISE * math.sqrt(4 * math.pi) * case.width_px
    image = LEVEL + light * np.einsum("sx,sy->yx", across, down) + NOISE * random.standard_normal((480, 480))
    step = 1 << (12 - case.bits)
    return np.clip(np.floor(image / step) * step, 0, 4096).astype(np.uint16), xy_px


def errors(case: Case, images: int) -> tuple[float, float, float]:
    """The share of the stars that is found, the error on each axis (rms, px), and that of the literal extraction."""
    random = np.random.default_rng(1)
    off_px: list[float] = []
    literal_px: list[float] = []
    for _ in range(images):
        image, xy_px = image_of(case, random)
        for objects, off in (
            (extract_sub_pixel(image, step=1 << (12 - case.bits)), off_px),
            (extract(image), literal_px),
        ):
            distance = np.linalg.norm(objects[0][None] - xy_px[:, None], axis=2)
            nearest = distance.min(axis=1, initial=math.inf)
            off.extend(nearest[nearest < FOUND_WITHIN_PX].tolist())
    rms = [math.sqrt(np.square(some).mean() / 2) if some else math.nan for some in (off_px, literal_px)]
    return len(off_px) / STARS / images, *rms


def main() -> None:
    """Print the table: each cell is the error in px, with the share that is found where it is not all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=4)
    images = parser.parse_args().images
    print("| bits | width px | " + " | ".join(f"S/N {ratio}" for ratio in RATIOS) + " | literal, S/N 100 |")
    print("|---|---|" + "---|" * (len(RATIOS) + 1))
    for bits in BITS:
        for width_px in WIDTHS_PX if bits == BITS[0] else (1.2,):
            found = [errors(Case(ratio, width_px, bits), images) for ratio in RATIOS]
            cells = [
                f"{error:.3f} ({math.sqrt(2) * width_px / ratio:.3f})" + (f", {100 * share:.0f} %" if share < 1 else "")
                if share
                else "-"
                for ratio, (share, error, _) in zip(RATIOS, found, strict=True)
            ]
            print(f"| {bits} | {width_px} | " + " | ".join(cells) + f" | {found[4][2]:.2f} |")


if __name__ == "__main__":
    main()
