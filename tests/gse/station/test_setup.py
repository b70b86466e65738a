"""What stands ready before the first byte: the stars where they are in the year of the session."""

import math

import numpy as np
import pytest
from devices.programs import program

from gse.camera import Camera
from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.external.answers import ExternalAnswer, FailureKind
from gse.instant import from_text
from gse.panorama import Panorama
from gse.station.setup import ORION_RA_DE_DEG, example_places, set_up

MOTION_MAS_PER_YEAR = 1000.0


def hipparcos(stars):
    """Random stars in the layout of hip_main.dat that all move north."""
    rng = np.random.default_rng(3)
    lines = []
    for number in range(stars):
        field = [" "] * 78
        field[:6] = ["H", str(number + 1), " ", " ", " ", f"{rng.uniform(1, 6):.2f}"]
        field[8:10] = f"{rng.uniform(0, 360):.8f}", f"{math.degrees(math.asin(rng.uniform(-0.99, 0.99))):.8f}"
        field[12:14] = "0.00", f"{MOTION_MAS_PER_YEAR:.2f}"
        lines.append("|".join(field))
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    path = tmp_path_factory.mktemp("catalogue") / "hip_main.dat"
    path.write_text(hipparcos(3000))
    return parse_station(f"{BUILT_IN_TEXT}\ncatalog: {path}\n")


def moved_arcsec(catalog, source):
    """How far each star of a catalogue stands north of its place in the source, by its number."""
    places = {int(number): row for row, number in enumerate(source.ids)}
    rows = [places[int(number)] for number in catalog.ids]
    return np.degrees(np.arcsin(catalog.icrs[:, 2]) - np.arcsin(source.icrs[rows, 2])) * 3600


def test_the_stars_of_a_session_stand_where_their_proper_motion_has_brought_them(station):
    source = load_catalog(station.catalog)
    setup = set_up(station, "", utc_ns=from_text("2026-03-20T18:30:00Z"))
    assert setup.reference is not None
    for catalog in (setup.identifier.catalog, setup.reference.catalog):
        assert catalog.epoch_jyear == 2026.2
        north = np.median(moved_arcsec(catalog, source))
        assert north == pytest.approx((2026.2 - 1991.25) * MOTION_MAS_PER_YEAR / 1000, abs=0.01)


def test_without_an_instant_the_stars_stand_where_their_catalogue_has_them(station):
    assert set_up(station, "").identifier.catalog.epoch_jyear == 1991.25


def test_a_program_has_as_many_milliseconds_as_the_station_file_gives_it(tmp_path):
    """It answers after 0.4 s and is given 0.1 s, but for the first panorama, for which it has to start."""
    slow = program(tmp_path, "for line in sys.stdin: time.sleep(0.4); answer(json.loads(line))\n")
    identifier = f"identifier: {{algorithm: external, command: [{slow}], timeout_ms: 100, catalog_stars: 500}}\n"
    source = set_up(parse_station(f"{BUILT_IN_TEXT}{identifier}"), "").identifier.source
    panoramas = [Panorama(0, np.array([[1.0, 2.0]]), np.ones(1), number) for number in (1, 2)]
    given = [source.answers([panorama])[0] for panorama in panoramas]
    source.close()
    assert isinstance(given[0].answer, ExternalAnswer)
    assert given[1].answer.kind is FailureKind.TIMEOUT


def test_the_example_panorama_has_all_bright_stars_about_orion():
    camera, catalog = Camera(1000, 1000, 4000.0, (499.5, 499.5)), load_catalog(stars=500)
    places, brightness = example_places(catalog, camera)
    assert camera.contains(places).all()
    assert (np.diff(brightness) < 0).all()
    ra, de = np.radians(ORION_RA_DE_DEG)
    middle = [math.cos(ra) * math.cos(de), math.sin(ra) * math.cos(de), math.sin(de)]
    apart_px = 4000 * np.tan(np.arccos(np.clip(catalog.icrs @ middle, 0.01, 1)))
    seen_px = np.hypot(*(places - 499.5).T)
    assert np.sort(seen_px[seen_px < 500]) == pytest.approx(np.sort(apart_px[apart_px < 500]), abs=0.01)
