"""The programs of docs/external-identifiers.md, as they are printed there."""

import math
import sys
from pathlib import Path
from textwrap import dedent

import numpy as np
from devices.compiler import shared_library
from skies.made_frames import FIELD_14_DEG, Noise, made_frame, sky_of

from gse.catalog import load_catalog
from gse.catalog.flight import write_list
from gse.external.answers import ExternalAnswer
from gse.external.identifier import RunningIdentifier
from gse.external.panoramas import SensorDescription
from gse.external.plugs import plug_of
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama
from gse.values.spiral import spiral_directions

TEXT = (Path(__file__).parents[3] / "docs" / "external-identifiers.md").read_text()
SENSOR = SensorDescription("made", FIELD_14_DEG, 4096)


def printed(begin, end):
    """The indented lines of the document from one to another."""
    start = TEXT.index(begin)
    return dedent("    " + TEXT[start : TEXT.index(end, start) + len(end)]) + "\n"


def answered(panoramas, **options):
    identifier = RunningIdentifier(plug_of(IdentifierOptions(algorithm="external", **options), SENSOR), 20.0)
    given = [one.answer for one in identifier.answers(panoramas)]
    identifier.close()
    return given


def test_the_solver_in_python_finds_the_sky(tmp_path):
    (tmp_path / "solver.py").write_text(printed("#!/usr/bin/env python3", "flush=True)"))
    catalog = load_catalog()
    with (tmp_path / "stars.csv").open("w") as out:
        write_list(catalog.rows(slice(0, 4000)), out)
    sky, random = sky_of(catalog, FIELD_14_DEG, 6.0), np.random.default_rng(3)
    frames = [made_frame(sky, FIELD_14_DEG, direction, Noise(), random) for direction in spiral_directions(12)]
    panoramas = [Panorama(0, frame.xy_px, frame.brightness, number) for number, frame in enumerate(frames)]
    given = answered(panoramas, command=(sys.executable, "solver.py", "stars.csv"), directory=str(tmp_path))
    assert all(isinstance(answer, ExternalAnswer) and answer.attitude is not None for answer in given)
    for answer, frame in zip(given, frames, strict=True):
        assert math.dist(answer.attitude.boresight_icrs, frame.icrs_to_sensor[2]) < math.radians(0.05)


def test_the_library_in_c_compiles_and_answers(tmp_path):
    library = shared_library(printed('#include "gse_identifier.h"', "return 0;\n    }\n"), tmp_path)
    place = np.array([[512.0, 256.0]])
    full, none = Panorama(0, place, np.array([9.0]), 1), Panorama(0, place[:0], np.empty(0), 2)
    first, second = answered([full, none], library=str(library))
    assert (first.document["ra_deg"], first.document["de_deg"], first.has_roll) == (0.5, 0.25, False)
    assert (second.attitude, second.status) == (None, "TOO_FEW")
