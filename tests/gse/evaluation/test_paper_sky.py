"""The sky of the pivot paper: numbers that the paper prints, and its figures as files."""

import math

import numpy as np
import pytest

from gse.evaluation.paper_figures import (
    FIGURES,
    PaperSky,
    distinct_magnitude,
    fields_on_sky,
    stars_to,
    write_sky_figures,
)
from gse.evaluation.plan import PIVOT_PAPER, PRESETS, Plan
from gse.identifier.pivot import Cells

FIELD_RAD = math.radians(8)


@pytest.fixture(scope="module")
def sky():
    return PaperSky.from_plan(Plan(PRESETS[PIVOT_PAPER].optics, (), 100, 1, "gaia", angle_noise=True))


def test_equations_1_and_2_give_the_numbers_of_the_paper():
    assert (round(fields_on_sky(FIELD_RAD)), round(stars_to(4.5))) == (821, 871)
    assert abs(distinct_magnitude(821) - 4.45) < 0.01


def test_a_mean_of_one_star_leaves_fields_without_one_as_chance_has_it(sky):
    found = sky.distinct_star()
    assert (found["fields_eq_1"], found["magnitude"]) == (821.0, 4.45)
    assert found["stars_eq_2"] == 821.0
    at_random = 1 - math.exp(-found["stars"] / found["fields_eq_1"])
    assert abs(found["fields_with_one"] - at_random) < 0.1


def test_every_figure_is_drawn_with_its_counts(sky, tmp_path):
    paths = write_sky_figures(sky, 100, tmp_path)
    assert [path.name for path in paths] == list(FIGURES)
    texts = {path.name: path.read_text() for path in paths}
    assert all(text.startswith("<?xml") and "</svg>" in text for text in texts.values())
    assert (len(sky.source), len(Cells.for_field(FIELD_RAD))) == (9096, 529)


def test_the_zones_of_the_cells_hold_the_stars_that_have_their_indices(sky):
    cells = Cells.for_field(FIELD_RAD)
    zones = cells.zones_deg()
    assert sum(parts for _, _, parts in zones) == len(cells)
    de_deg = np.degrees(np.arcsin(sky.mission.icrs[:, 2]))
    width = 2 * np.floor(np.sqrt(cells.index(sky.mission.icrs))) + 1
    for low_deg, high_deg, parts in zones:
        inside = (de_deg > low_deg + 1e-9) & (de_deg < high_deg - 1e-9)
        assert (width[inside] == parts).all()
