"""The sensor's own answers beside the onboard-equivalent ones."""

from types import SimpleNamespace

import numpy as np
import pytest
from skies.known_nights import session

from gse.diagnosis.sensor_findings import sensor_findings
from gse.station.columns import FRAME, STATUSES
from gse.station.results import Status, Subject
from gse.statistics.onboard_equivalence import OnboardEquivalence, equivalence
from gse.statistics.sampling import Percentiles
from gse.statistics.session_statistics import statistics
from protocols import AttitudeMessage


def answer(made, first=0, until=None, *, off_arcsec=0.0, state="acquired"):
    rows = made.frames.columns.rows()
    for row in rows[first:until]:
        made.sensor_attitudes.append(
            int(row["utc_ns"]),
            AttitudeMessage(
                time_us=int(row["time_us"]),
                ra_deg=round(float(row["ra_deg"]), 6),
                de_deg=round(float(row["de_deg"]) + off_arcsec / 3600, 6),
                roll_deg=(float(row["roll_deg"]) + 360) % 360,
                frame_no=int(row["frame_no"]),
                state=state,
                latency_s=0.08,
            ),
        )


def test_a_sensor_that_answers_as_its_rebuilding_is_equivalent():
    made = session(100)
    answer(made)
    own = statistics(made).equivalence
    assert own.same
    assert (own.answers, own.both, own.only_sensor, own.only_station) == (100, 100, 0, 0)
    assert own.separation_arcsec.max < 0.01
    assert own.latency_ms.p50 == pytest.approx(80)
    assert named(made) == []


def named(made):
    found = statistics(made)
    return [str(one) for one in sensor_findings(made, found.own, found.convention, found.equivalence)]


def test_a_sensor_that_does_not_answer_what_is_answered_here_is_named():
    made = session(100)
    answer(made, until=50)
    answer(made, 50, state="lost")
    own = statistics(made).equivalence
    assert not own.same
    assert (own.both, own.only_station) == (50, 50)
    assert named(made)[0].startswith("sensor answers otherwise: of 100 panoramas, 50 were answered only here")


def test_another_identifier_of_the_same_noise_is_no_fault():
    made = session(100, noise=5.0)
    for first in range(0, 100, 2):
        answer(made, first, first + 1, off_arcsec=4.0)
        answer(made, first + 1, first + 2, off_arcsec=-4.0)
    assert not statistics(made).equivalence.same
    assert named(made) == []


def test_an_answer_beside_a_confirmed_one_is_false_where_it_names_other_stars():
    """0.3 deg off is within half a degree of the median, and yet not where the stars of its panorama are."""
    made = session(100)
    answer(made, until=90)
    answer(made, 90, 95, off_arcsec=170.0)
    answer(made, 95, off_arcsec=1080.0)
    found = statistics(made)
    assert found.subjects[Subject.SENSOR].false_answers.count == 5
    assert not (found.own_counted.false & found.own_counted.used).any()


def test_a_sensor_without_answers_of_its_own_is_not_compared():
    assert statistics(session(10)).equivalence is None


@pytest.mark.parametrize(
    ("sensor_deg", "station_deg", "apart_arcsec"),
    [(25.0, 25.0, 0.0), (359.9, 0.1, 720.0), (0.1, 359.9, 720.0), (10.0, 10.25, 900.0), (180.0, 0.0, 648_000.0)],
)
def test_two_rolls_are_as_far_apart_as_the_shorter_way_round(sensor_deg, station_deg, apart_arcsec):
    made = session(3)
    answer(made)
    made.frames.columns["roll_deg"][:] = station_deg
    made.sensor_attitudes.columns["roll_deg"][:] = sensor_deg
    assert statistics(made).equivalence.roll_arcsec.p50 == pytest.approx(apart_arcsec, abs=0.1)


@pytest.mark.parametrize(("off_arcsec", "is_false"), [(170.0, False), (210.0, True)])
def test_an_answer_is_false_where_it_lies_further_from_a_confirmed_one_than_two_of_the_same_stars(off_arcsec, is_false):
    made = session(100)
    answer(made, until=99)
    answer(made, 99, off_arcsec=off_arcsec)
    stats = statistics(made)
    assert stats.subjects[Subject.SENSOR].false_answers.count == is_false
    assert stats.subjects[Subject.SENSOR].axes["d_de"].n == 100 - is_false


# By hand


def mask(text):
    return np.array([sign == "x" for sign in text])


def both_sides(count, identified=None):
    """Frames that are all identified, and a sensor that answers them alike."""
    frames = np.zeros(count, dtype=FRAME)
    frames["status"] = STATUSES.index(Status.NO_MATCH)
    frames["status"][mask(identified) if identified else slice(None)] = STATUSES.index(Status.IDENTIFIED)
    frames["ra_deg"], frames["de_deg"], frames["roll_deg"], frames["matched"] = 10.0, 60.0, 30.0, 9
    columns = {name: frames[name].astype(np.float64) for name in ("ra_deg", "de_deg", "roll_deg")}
    every = np.ones(count, dtype=bool)
    own = SimpleNamespace(sent=every, acquired=every.copy(), latency_ms=np.arange(float(count)), **columns)
    return frames, own


def test_answers_are_counted_by_the_side_that_gave_them_without_what_is_excluded_or_was_not_sent():
    frames, own = both_sides(10, identified="xxxx..x.x.")
    own.acquired, own.sent = mask("xxx.xx.xx."), mask("xxxxxxxx.x")
    matched = np.array([9, 8, 9, 9, 9, 9, 9, 9, 9, 9], dtype=np.uint16)
    found = equivalence(frames, mask(".......x.."), matched, own)
    assert (found.answers, found.both, found.only_sensor, found.only_station) == (8, 3, 2, 2)
    assert found.same_number == 2
    assert (found.separation_arcsec.n, found.roll_arcsec.n, found.latency_ms.n) == (3, 3, 8)
    assert (found.latency_ms.p50, found.latency_ms.max) == (3.5, 9.0)
    assert equivalence(frames, mask("xxxxxxxx.x"), matched, own) is None


def test_boresights_lie_as_far_from_each_other_as_a_chord_on_the_sphere():
    frames, own = both_sides(3)
    own.ra_deg, own.de_deg = np.array([10.0, 10.01, 10.0]), np.array([60.0, 60.0, 59.99])
    found = equivalence(frames, mask("..."), frames["matched"], own)
    assert found.separation_arcsec.p50 == pytest.approx(18.0, rel=1e-5)  # half of 36 arcsec, at 60 deg
    assert found.separation_arcsec.max == pytest.approx(36.0, rel=1e-5)


def test_each_of_many_answers_is_compared_with_its_own():
    """More than are taken at once."""
    frames, own = both_sides(40_000)
    rng = np.random.default_rng(2)
    frames["ra_deg"] = own.ra_deg = rng.uniform(0, 360, 40_000)
    frames["de_deg"] = own.de_deg = rng.uniform(-80, 80, 40_000)
    own.de_deg = own.de_deg + np.linspace(0.0, 100.0, 40_000) / 3600
    found = equivalence(frames, np.zeros(40_000, dtype=bool), frames["matched"], own)
    sizes = found.separation_arcsec
    assert (sizes.n, sizes.p50, sizes.p95, sizes.max) == pytest.approx((40_000, 50.0, 95.0, 100.0), abs=1e-3)


@pytest.mark.parametrize(
    ("only_sensor", "only_station", "greatest_arcsec", "is_same"),
    [
        (0, 0, 1.0, True),
        (0, 0, 1.0001, False),
        (1, 0, 0.0, False),
        (0, 1, 0.0, False),
        (1, 1, 0.0, False),
        (0, 0, np.nan, True),
    ],
)
def test_both_sides_are_the_same_within_an_arcsecond_where_neither_answers_alone(
    only_sensor, only_station, greatest_arcsec, is_same
):
    size, other = Percentiles(9, 0.1, 0.2, 0.3, greatest_arcsec), Percentiles(9, 50.0, 60.0, 70.0, 80.0)
    assert OnboardEquivalence(9, 9, only_sensor, only_station, 0, size, other, other).same is is_same
