"""What a sensor states of its own answers, against errors that were put into them."""

from dataclasses import replace

import numpy as np
import pytest
from devices.items_sensor import LINES
from numpy.typing import NDArray
from scipy.signal import lfilter
from skies.own_answers import with_answers, without_error
from skies.synthetic_night import synthetic_night

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.report.page import report_html
from gse.report.provenance import provenance
from gse.report.summary import summarise
from gse.station.housekeeping import ITEM, Housekeeping
from gse.station.session_data import SessionData
from gse.statistics.session_statistics import statistics
from gse.statistics.stated import _stated_accuracy, errors_by_quality, stated_accuracy
from gse.values.attitude_convention import AnswerRotation, AttitudeConvention, read_angles, state_angles
from gse.verdict.assessment import judge
from protocols import parse_protocol

TEXT = (
    LINES
    + """\
messages:
  ATTITUDE:
    code: ATT
    direction: from sensor
    fields:
      - {name: time, type: decimal, unit: us}
      - {name: ra, type: decimal, unit: deg}
      - {name: de, type: decimal, unit: deg}
    items:
      - {name: sigma_x, type: decimal, unit: arcsec}
      - {name: sigma_y, type: decimal, unit: mdeg}
      - {name: sigma_z, type: decimal, unit: arcsec}
"""
)
PROTOCOL = parse_protocol(TEXT, "stated.yaml")
UNITS_ARCSEC = np.array([1.0, 3.6, 1.0])
COUNT = 600
SCATTER = np.array([4.0, 8.0, 40.0])
BIAS = np.array([3.0, -7.0, 20.0])


def turned(session: SessionData, turns_arcsec: NDArray[np.float64]) -> SessionData:
    """The session with answers of a sensor that are turned about its axes from what an errorless one says."""
    true = read_angles(without_error(session, whole_field=True), AttitudeConvention())
    x, y, z = np.radians(turns_arcsec.T / 3600)
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    measured = (np.eye(3) - cross) @ true  # its axes turn by w, so that what they show turns the other way
    measured /= np.linalg.norm(measured, axis=2)[:, :, None]
    return with_answers(session, state_angles(measured, session.station.sensor.attitude), np.full(len(true), 20))


def stating(session: SessionData, values: NDArray[np.float64], protocol=PROTOCOL, *, stride: int = 1) -> SessionData:
    """The session with these values (M, K) of items, one row per answer."""
    rows = np.zeros(values.size, ITEM)
    rows["item"] = np.tile(np.arange(values.shape[1]), len(values))
    rows["value"] = values.ravel()
    session.housekeeping = Housekeeping(protocol.items)
    session.housekeeping.stride = stride
    session.housekeeping.extend(rows)
    return session


def errors() -> NDArray[np.float64]:
    return np.random.default_rng(5).normal(0, SCATTER, (COUNT, 3))


def accuracy_of(stated_arcsec: NDArray[np.float64], *, stride: int = 1):
    made = turned(synthetic_night(COUNT, trouble=False), BIAS + errors())
    made = stating(made, stated_arcsec / UNITS_ARCSEC, stride=stride)
    return made, stated_accuracy(made, statistics(made))


def test_answers_that_scatter_as_stated_have_a_chi_square_of_one_whatever_their_bias() -> None:
    _, found = accuracy_of(np.tile(SCATTER, (COUNT, 1)))
    assert [of.axis for of in found] == ["x", "y", "z"]
    assert [of.scatter_arcsec for of in found] == pytest.approx(errors().std(axis=0).tolist(), rel=0.01)
    assert [of.stated_arcsec for of in found] == pytest.approx(SCATTER.tolist())
    assert all(of.low < 1 < of.high and of.word == "as stated" for of in found)


def test_a_sigma_that_is_stated_too_small_or_too_large_is_told() -> None:
    _, found = accuracy_of(np.tile(SCATTER * [0.5, 2.0, 1.0], (COUNT, 1)))
    assert [of.word for of in found] == ["more than stated", "less than stated", "as stated"]
    assert [of.chi_square for of in found] == pytest.approx([4.0, 0.25, 1.0], rel=0.2)


def test_each_answer_is_divided_by_its_own_sigma_also_where_not_all_are_kept() -> None:
    sigmas = SCATTER * np.array([0.1, 0.5, 3.0])[np.arange(COUNT) % 3, None]
    turns = BIAS + errors() * sigmas / SCATTER
    for stride in (1, 2):
        made = stating(turned(synthetic_night(COUNT, trouble=False), turns), sigmas / UNITS_ARCSEC, stride=stride)
        found = stated_accuracy(made, statistics(made))
        assert [of.answers for of in found] == [COUNT // stride] * 3
        assert [of.chi_square for of in found] == pytest.approx([1.0] * 3, rel=0.2)


def test_turns_are_taken_about_the_axes_of_the_frame_of_the_answers() -> None:
    third, half, sixth = 3**-0.5, 2**-0.5, 6**-0.5
    cube = AnswerRotation(
        axes=((half, -sixth, third), (0.0, 2 * sixth, third), (-half, -sixth, third)), uncertainty_arcsec=0.0
    )
    station = parse_station(BUILT_IN_TEXT)
    convention = replace(station.sensor.attitude, rotation=cube)
    station = station.model_copy(update={"sensor": station.sensor.model_copy(update={"attitude": convention})})
    about_z = np.outer(errors()[:, 2], cube.matrix()[:, 2])
    made = turned(synthetic_night(COUNT, station=station, trouble=False), about_z)
    x, y, z = stated_accuracy(stating(made, np.ones((COUNT, 3))), statistics(made))
    assert x.scatter_arcsec < 0.1 > y.scatter_arcsec
    assert z.scatter_arcsec == pytest.approx(errors()[:, 2].std(), rel=0.01)


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_the_interval_holds_one_in_at_least_nine_of_ten_sessions(correlation) -> None:
    generator, sessions = np.random.default_rng(3), 60
    utc_ns, sigma = np.arange(COUNT) * 10**8, np.full(COUNT, 5.0)
    inside = 0
    for _ in range(sessions):
        steps = generator.normal(0, np.sqrt(1 - correlation**2), COUNT + 100)
        error = 5.0 * lfilter([1.0], [1.0, -correlation], steps)[100:]
        inside += _stated_accuracy("x", error, sigma, utc_ns).word == "as stated"
    assert inside >= 0.9 * sessions


def test_a_short_session_is_too_short_to_tell() -> None:
    made = stating(turned(synthetic_night(20, trouble=False), errors()[:20]), np.tile(SCATTER / UNITS_ARCSEC, (20, 1)))
    assert {of.word for of in stated_accuracy(made, statistics(made))} == {"too few independent answers to tell"}


def test_the_report_has_a_table_of_the_stated_accuracy() -> None:
    session, found = accuracy_of(np.tile(SCATTER, (COUNT, 1)))
    assessment = judge(session)
    report = summarise(session, assessment)
    assert [of["answers"] for of in report["stated_accuracy"]] == [of.answers for of in found]
    page = report_html(session, assessment, report, provenance(session.versions, None), plots=False)
    assert "Accuracy that the sensor states" in page


def of_quality(quality: NDArray[np.float64], values: str = "") -> SessionData:
    """A session whose answers are 2 arcsec off per unit of their quality, and false at 9."""
    off = np.where(quality == 9, 3600.0, 2 * quality)
    made = turned(synthetic_night(len(quality), trouble=False), np.outer(off, [0.0, 1.0, 0.0]))
    text = f"{TEXT[: TEXT.index('    items:')]}    items: [{{name: quality, type: decimal{values}}}]\n"
    return stating(made, quality[:, None], parse_protocol(text, "quality.yaml"))


def test_each_quality_has_its_errors_and_false_answers() -> None:
    made = of_quality(np.tile([1.0, 4.0, 9.0, 4.0], 50), ", values: {1: good, 4: fair, 9: poor}")
    found = errors_by_quality(made, statistics(made))
    assert [(of.lowest, of.highest) for of in found] == [("good", "good"), ("fair", "fair"), ("poor", "poor")]
    assert [(of.answers, of.false) for of in found] == [(50, 0), (100, 0), (50, 50)]
    assert [of.median_arcsec for of in found] == pytest.approx([2.0, 8.0, 3600.0], abs=0.5)
    report = summarise(made, judge(made))
    page = report_html(made, judge(made), report, provenance(made.versions, None), plots=False)
    assert "by the quality that the sensor states" in page


def test_a_quality_of_many_values_has_four_groups_of_equally_many_answers() -> None:
    made = of_quality(np.tile(np.arange(10.0, 30.0), 10))
    found = errors_by_quality(made, statistics(made))
    assert [(of.lowest, of.highest, of.answers) for of in found] == [
        (10, 14, 50), (15, 19, 50), (20, 24, 50), (25, 29, 50)
    ]  # fmt: skip
    assert [of.p95_arcsec for of in found] == pytest.approx([28.0, 38.0, 48.0, 58.0], abs=0.5)


def test_a_sensor_that_states_no_accuracy_has_none() -> None:
    session = synthetic_night(5)
    assert stated_accuracy(session, statistics(session)) == ()
    assert errors_by_quality(session, statistics(session)) == ()
    assert "stated_accuracy" not in summarise(session, judge(session))
