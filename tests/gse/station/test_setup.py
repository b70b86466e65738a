"""What stands ready before the first byte: the stars where they are in the year of the session."""

import hashlib
import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from devices.programs import program

from gse.catalog import StarCatalog, load_catalog, stars_searched
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import UsageError
from gse.external.answers import ExternalAnswer, FailureKind
from gse.external.identifier import ExternalIdentifier
from gse.external.panoramas import WireUnit
from gse.identifier.robust import stars_looked_at
from gse.station.setup import (
    ORION_RA_DE_DEG,
    PACKAGES,
    Setup,
    catalog_of,
    check_external,
    clear_caches,
    example_places,
    keep_one_sky,
    sensor_description,
    set_up,
    versions,
)
from gse.values.camera import Camera
from gse.values.instant import from_text
from gse.values.panorama import Panorama
from protocols import load_protocol

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


# What stands in the setup, without a session


def made_catalog(**changes):
    """Three stars of which one has no known motion."""
    motion = np.array([[0.0, 0.0, 1e-8], [0.0, 0.0, 0.0], [1e-8, 0.0, 0.0]])
    stars = StarCatalog("made", 2026.2, np.array([30, 10, 20]), np.eye(3), np.array([1.0, 2.0, 5.126]), "HIP", motion)
    return replace(stars, **changes)


class Reading:
    """An identifier that has a catalogue and is asked for nothing."""

    name = "reading"

    def __init__(self, catalog):
        self.catalog = catalog


def setup_of(identifier, reference=None):
    return Setup(None, "", None, None, identifier, reference)


def test_the_facts_of_a_catalogue_are_those_of_the_report():
    assert setup_of(Reading(made_catalog(rest_epoch_jyear=1991.25))).catalog_facts() == {
        "source": "made",
        "epoch_jyear": 2026.2,
        "at_rest": 1,
        "rest_epoch_jyear": 1991.25,
        "stars": 3,
        "sha256_of_ids": hashlib.sha256(struct.pack("<3q", 30, 10, 20)).hexdigest(),
        "faintest_magnitude": 5.13,
    }


def test_a_catalogue_without_an_epoch_of_rest_rests_at_its_own_and_an_empty_one_has_no_faintest_star():
    facts = setup_of(Reading(made_catalog())).catalog_facts()
    assert facts["rest_epoch_jyear"] == 2026.2
    empty = setup_of(Reading(made_catalog().rows(slice(0, 0)))).catalog_facts()
    assert (empty["stars"], empty["faintest_magnitude"]) == (0, None)


def test_true_stars_are_found_by_the_reference_identifier_or_by_the_one_under_test_where_that_is_it():
    one, other = Reading(made_catalog()), Reading(made_catalog())
    assert setup_of(one, other).of_true_stars is other
    assert setup_of(one).of_true_stars is one


def test_answers_come_from_outside_where_an_external_identifier_is_under_test():
    source = object()
    assert setup_of(ExternalIdentifier(made_catalog(), source)).external is source
    assert setup_of(Reading(made_catalog())).external is None


def external_station(tmp_path):
    silent = program(tmp_path, "", head="")
    return parse_station(f"{BUILT_IN_TEXT}identifier: {{algorithm: external, command: [{silent}], timeout_ms: 250}}\n")


def test_a_program_that_is_there_is_checked_without_a_word_and_one_that_is_not_is_an_error(tmp_path):
    said = []
    station = external_station(tmp_path)
    protocol = load_protocol(station.protocol)
    check_external(station, protocol, said.append)
    (tmp_path / "onboard").unlink()
    with pytest.raises(UsageError, match="onboard"):
        check_external(station, protocol, said.append)
    check_external(parse_station(BUILT_IN_TEXT), protocol, said.append)
    assert said == []


def test_what_may_load_for_a_long_time_is_told_before_it_is_loaded():
    said = []
    station = parse_station(f"{BUILT_IN_TEXT}identifier: {{algorithm: external, library: no/such/library.so}}\n")
    with pytest.raises(UsageError, match=r"library\.so"):
        check_external(station, load_protocol(station.protocol), said.append)
    assert said == ["loading the external identifier library.so"]


def test_a_sensor_is_described_with_the_units_of_its_wire():
    """panorama-v1-subpixel has y and x in 1/32 px; its index values are whole."""
    station = parse_station(BUILT_IN_TEXT)
    described = sensor_description(station, load_protocol("panorama-v1-subpixel"))
    sensor = station.sensor
    assert (described.name, described.camera, described.index_max) == (sensor.name, sensor.camera(), sensor.index_max)
    assert (described.y, described.x, described.index) == (WireUnit(1 / 32), WireUnit(1 / 32), WireUnit())


@pytest.mark.parametrize(
    ("text", "jyear"),
    [
        (None, 1991.25),
        ("2000-01-01T12:00:00Z", 2000.0),
        ("2026-04-02T06:00:00Z", 2026.2),  # 26.25 years of 365.25 days after the first end on 2 April at 7:30
        ("2026-04-02T09:00:00Z", 2026.3),
        ("2026-12-25T00:00:00Z", 2027.0),
    ],
)
def test_stars_stand_where_they_do_in_the_nearest_tenth_of_a_year(station, text, jyear):
    assert catalog_of(station, text and from_text(text)).epoch_jyear == jyear


def test_the_packages_that_numbers_depend_on_have_versions():
    found = versions()
    assert found["numpy"] == np.__version__
    assert list(found) == ["gse-star-sensor", *PACKAGES]


@pytest.mark.parametrize(("algorithm", "has_reference"), [("neighbour", True), ("robust", False)])
def test_any_identifier_but_the_reference_itself_has_a_reference(algorithm, has_reference):
    station = parse_station(f"{BUILT_IN_TEXT}identifier: {{algorithm: {algorithm}}}\n")
    said = []
    setup = set_up(station, "text", tell=said.append)
    assert (setup.reference is not None) is has_reference
    assert setup.identifier.name == algorithm
    assert (setup.station, setup.station_text, setup.protocol.name) == (station, "text", station.protocol)
    assert said == []  # it is compiled


class RecordedAnswers:
    """Answers of a session that was recorded: no program is started for them."""


def test_there_are_as_many_stars_as_the_identifier_that_uses_most_of_them_looks_at():
    station = parse_station(
        f"{BUILT_IN_TEXT}identifier: {{algorithm: external, catalog_stars: 100, command: [none]}}\n"
    )
    camera = station.sensor.camera()
    few = set_up(station, "", recorded_answers=RecordedAnswers())
    assert len(few.identifier.catalog) == stars_looked_at(camera) > stars_searched(camera, 100)


def test_recorded_answers_stand_in_the_place_of_a_program():
    station = parse_station(f"{BUILT_IN_TEXT}identifier: {{algorithm: external, command: [no-such-program]}}\n")
    source = RecordedAnswers()
    assert set_up(station, "", recorded_answers=source).external is source


# The example panorama, by the geometry of a pinhole


def test_the_example_panorama_looks_at_the_belt_of_orion():
    """Alnilam, its middle star, stands at 84.05 and -1.20 deg."""
    ra_deg, de_deg = ORION_RA_DE_DEG
    assert math.hypot(ra_deg - 84.053, de_deg + 1.202) < 2.0


def test_the_example_panorama_has_north_up_and_east_left_and_its_stars_brightest_first():
    camera, catalog = Camera(1000, 1000, 4000.0, (499.5, 499.5)), load_catalog(stars=500)
    places, brightness = example_places(catalog, camera)
    ra, de = np.radians(83.0), 0.0
    x, y, z = catalog.icrs.T
    east, north = y * math.cos(ra) - x * math.sin(ra), z * math.cos(de)
    ahead = x * math.cos(ra) + y * math.sin(ra)
    expected = 499.5 - 4000.0 * np.column_stack([east, north])[ahead > 0.9] / ahead[ahead > 0.9][:, None]
    expected = expected[((expected > -0.5) & (expected < 999.5)).all(axis=1)]
    assert places == pytest.approx(expected[:30], abs=1e-6)
    assert (brightness[0], brightness[-1], len(brightness)) == (4000.0, 100.0, len(places))
    assert (np.diff(brightness) < 0).all()


def test_the_example_panorama_of_a_wide_field_has_thirty_stars_within_sixty_degrees():
    camera = Camera(1000, 1000, 100.0, (499.5, 499.5))
    places, _ = example_places(load_catalog(stars=500), camera)
    assert len(places) == 30
    assert 100 * math.tan(math.radians(50)) < np.hypot(*(places - 499.5).T).max() < 100 * math.tan(math.radians(60))


def test_the_sky_of_one_date_is_kept_and_those_of_two_are_dropped(station):
    clear_caches()
    first = catalog_of(station, None)
    keep_one_sky()
    assert catalog_of(station, None) is first
    assert catalog_of(station, from_text("2026-03-20T18:30:00Z")).epoch_jyear == 2026.2
    keep_one_sky()
    assert catalog_of(station, None) is not first
