"""Search plan of the robust identifier: its passes over a panorama, from the quick to the thorough.

Each pass takes the objects as alpha stars in turn, lets the partners of each vote for catalogue stars at their
distances, and has the hypotheses that the votes make verified. A pass that ends without strong evidence is followed by
the next.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.process.jit import compiled_part

_ALL = 1e6


class Pass(NamedTuple):
    """One pass of the search, for a person.

    ``window_px`` is the tolerance of a distance between two objects and ``window_growth`` what it grows by per radian
    of the distance. ``partners`` of an alpha star vote, and the best ``hypotheses`` are kept. ``alpha_stars`` are
    tried. ``sigma_px`` is the noise of a position that is assumed. ``objects``, brightest first, take part; for each,
    the brightest ``stars_per_object`` catalogue stars per field do. An alpha star may be fainter by ``alpha_ranks``
    ranks among the catalogue stars of the field than it looks. A panorama of more than ``most_objects`` objects skips
    the pass. A hypothesis is first tried on the brightest ``first_tried`` objects.
    """

    purpose: str
    window_px: float
    window_growth: float
    partners: int
    hypotheses: int
    alpha_stars: int
    sigma_px: float
    stars_per_object: float
    objects: int
    alpha_ranks: int
    most_objects: int
    first_tried: int


PASSES = (
    Pass(
        "usual panoramas: the twelve brightest objects, with the tolerance of the LAPAN paper, eq 2-1",
        window_px=1.77,
        window_growth=0.0,
        partners=3,
        hypotheses=8,
        alpha_stars=5,
        sigma_px=0.5,
        stars_per_object=1.5,
        objects=12,
        alpha_ranks=5,
        most_objects=30,
        first_tried=12,
    ),
    Pass(
        "noisy positions, and several false objects among the brightest",
        window_px=3.5,
        window_growth=0.0,
        partners=4,
        hypotheses=16,
        alpha_stars=10,
        sigma_px=1.0,
        stars_per_object=2.0,
        objects=16,
        alpha_ranks=8,
        most_objects=30,
        first_tried=12,
    ),
    Pass(
        "detectors whose brightest objects are hot pixels: every object takes part",
        window_px=2.5,
        window_growth=0.0,
        partners=6,
        hypotheses=16,
        alpha_stars=30,
        sigma_px=0.7,
        stars_per_object=2.0,
        objects=30,
        alpha_ranks=30,
        most_objects=30,
        first_tried=30,
    ),
    Pass(
        "a wrong focal length, or very noisy positions",
        window_px=6.5,
        window_growth=0.006,
        partners=5,
        hypotheses=100,
        alpha_stars=12,
        sigma_px=1.9,
        stars_per_object=3.0,
        objects=30,
        alpha_ranks=30,
        most_objects=30,
        first_tried=12,
    ),
    Pass(
        "few objects: a faint catalogue star may be the brightest of them",
        window_px=2.5,
        window_growth=0.0,
        partners=10,
        hypotheses=1000,
        alpha_stars=12,
        sigma_px=0.7,
        stars_per_object=_ALL,
        objects=16,
        alpha_ranks=30,
        most_objects=16,
        first_tried=12,
    ),
    Pass(
        "few objects, and a wrong focal length or very noisy positions",
        window_px=6.5,
        window_growth=0.006,
        partners=10,
        hypotheses=1000,
        alpha_stars=12,
        sigma_px=1.9,
        stars_per_object=_ALL,
        objects=16,
        alpha_ranks=30,
        most_objects=16,
        first_tried=12,
    ),
)


class SearchPass(NamedTuple):
    """A pass for one camera: as ``Pass``, window and noise in radians, ``stars_per_object`` of the whole sky."""

    window_rad: float
    window_growth: float
    partners: int
    hypotheses: int
    alpha_stars: int
    sigma_rad: float
    stars_per_object: float
    objects: int
    alpha_ranks: int
    most_objects: int
    first_tried: int


def search_plan(
    pixel_rad: float, fields_on_sky: float, *, widest_px: float, sigma_px: float | None
) -> NDArray[np.float64]:
    """The passes for a camera, one row (11,) each, as ``search_pass`` reads them.

    No window is wider than ``widest_px``; ``sigma_px`` is the noise of a position where it is known.
    """
    passes = [
        SearchPass(
            min(step.window_px, widest_px) * pixel_rad,
            step.window_growth,
            step.partners,
            step.hypotheses,
            step.alpha_stars,
            (sigma_px or step.sigma_px) * pixel_rad,
            step.stars_per_object * fields_on_sky,
            step.objects,
            step.alpha_ranks,
            step.most_objects,
            step.first_tried,
        )
        for step in PASSES
    ]
    return np.array(passes)


_FEWEST_HYPOTHESES = 2


def plan_of_part(plan: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """The passes over a part of the sky that holds this share of its stars.

    That share of the bright stars is there. Of the best hypotheses twice the share is kept, two at least.
    """
    stars, kept = (SearchPass._fields.index(name) for name in ("stars_per_object", "hypotheses"))
    part = plan.copy()
    part[:, stars] *= share
    part[:, kept] = np.maximum(np.ceil(2 * share * plan[:, kept]), np.minimum(plan[:, kept], _FEWEST_HYPOTHESES))
    part[:, kept] = np.minimum(part[:, kept], plan[:, kept])
    return part


@compiled_part
def search_pass(row: NDArray[np.float64]) -> SearchPass:
    """The pass of one row of a plan: a plan goes to the compiled search as an array, which is quicker to hand over."""
    return SearchPass(
        row[0],
        row[1],
        int(row[2]),
        int(row[3]),
        int(row[4]),
        row[5],
        row[6],
        int(row[7]),
        int(row[8]),
        int(row[9]),
        int(row[10]),
    )
