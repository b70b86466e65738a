"""What each fine cause predicts, against mounts and sites that are turned by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.fft
import scipy.interpolate
from scipy.spatial.transform import Rotation

from gse.diagnosis.competing_models import Predictions
from gse.diagnosis.field_patterns import PARAMETERS, FieldOfErrors
from gse.diagnosis.fine_causes import FineHypothesis, causes_of_field, constant_causes, drifts
from gse.diagnosis.gross_causes import errors_arcsec
from gse.diagnosis.session_model import ErrorSeries, SessionModel
from gse.truth import horizon_to_sensor
from gse.values.mount import Mount
from gse.values.site import Site, SiteUncertainty

SITE = Site(latitude_deg=48.0, longitude_deg=11.0, pressure_hpa=1000.0, temperature_c=15.0)
MOUNT = Mount(azimuth_deg=130.0, altitude_deg=60.0, roll_deg=25.0)
COUNT = 24
TIME_S = 30.0 * np.arange(COUNT)
SKY_ARCSEC = 1_296_000 / 86_164.0905
"""By which the sky turns in a second."""
EAST, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
POLE = np.array([0.0, math.cos(math.radians(48.0)), math.sin(math.radians(48.0))])
FIELD_ROWS = np.arange(0, COUNT + 4, 4)
SHIFTS = np.random.default_rng(3).normal(size=(len(FIELD_ROWS), 3, len(PARAMETERS)))


def model_of(*, site=SITE, is_fitted=False, has_field=True, pixel_arcsec=(0.0, 0.0)):
    """In the coordinates of the errors themselves, which are none."""
    series = ErrorSeries(np.arange(COUNT), TIME_S, np.zeros((COUNT, 3)))
    none = np.zeros(0)
    field = FieldOfErrors(none, none, 1.0, none, none, FIELD_ROWS, SHIFTS, None, none, 0.01) if has_field else None
    return SessionModel(series, field, site, MOUNT, is_fitted, np.eye(3), pixel_arcsec)


def turned(axis, arcsec):
    """The errors of a mount that is measured where the horizon frame is turned about one of its axes."""
    turn = Rotation.from_rotvec(np.radians(arcsec / 3600) * axis).as_matrix()
    return errors_arcsec((horizon_to_sensor(MOUNT) @ turn)[None], horizon_to_sensor(MOUNT))[0]


def moved(**off_arcsec):
    """The errors of a mount that stands elsewhere than it says."""
    changed = {f"{name}_deg": getattr(MOUNT, f"{name}_deg") + arcsec / 3600 for name, arcsec in off_arcsec.items()}
    return errors_arcsec(horizon_to_sensor(replace(MOUNT, **changed))[None], horizon_to_sensor(MOUNT))[0]


def test_constant_causes_are_the_errors_of_a_mount_or_a_site_that_is_off_by_an_arcsec_and_a_clock_by_a_second():
    """Across, up and about the boresight: a turn across is one of the azimuth, on the sky."""
    boresight = horizon_to_sensor(MOUNT)[2]
    across = (UP - boresight[2] * boresight) / math.cos(math.radians(60.0))
    expected = [
        ("clock offset", "clock", [turned(POLE, SKY_ARCSEC)]),
        ("mount", "azimuth", [moved(azimuth=1.0)]),
        ("mount", "altitude", [moved(altitude=1.0)]),
        ("mount", "roll", [moved(roll=1.0)]),
        ("site", "latitude", [turned(EAST, 1.0)]),
        ("mount", "mount", [turned(across, 1.0), moved(altitude=1.0), moved(roll=1.0)]),
    ]
    found = list(constant_causes(model_of()))
    assert [(one.cause, one.kind) for one in found] == [(cause, kind) for cause, kind, _ in expected]
    for one, (_, _, means) in zip(found, expected, strict=True):
        assert one.columns.mean == pytest.approx(np.column_stack(means), abs=1e-4)
        assert one.columns.cosines == pytest.approx(0.0, abs=1e-9)
        assert not one.is_change
        assert not one.columns.field.any()


def test_a_constant_error_on_a_mount_that_was_fitted_has_no_cause():
    assert list(constant_causes(model_of(is_fitted=True))) == []


def test_drifts_are_those_from_the_first_frame_about_the_middle_and_up_to_the_last():
    """A clock by a millionth, and the mount by an arcsec in an hour."""
    found = list(drifts(model_of()))
    kinds = [
        ("clock drift", "clock drift"),
        *(("mount moves", kind) for kind in ("azimuth", "altitude", "roll", "mount moves")),
    ]
    assert [(one.cause, one.kind) for one in found] == 3 * kinds
    clock = turned(POLE, SKY_ARCSEC)
    azimuth, altitude, roll = moved(azimuth=1.0), moved(altitude=1.0), moved(roll=1.0)
    for place, since_s in enumerate((0.0, 345.0, 690.0)):
        course = TIME_S - since_s
        by_clock, *by_angles, by_all = found[5 * place : 5 * place + 5]
        cases = [(by_clock, 0, clock, 1e-6)]
        cases += [(one, 0, shift, 1 / 3600) for one, shift in zip(by_angles, (azimuth, altitude, roll), strict=True)]
        cases += [(by_all, 1, altitude, 1 / 3600), (by_all, 2, roll, 1 / 3600)]
        for one, column, shift, rate in cases:
            assert one.is_change
            errors = np.outer(rate * course, shift)
            size = rate * np.abs(shift).max()
            assert one.columns.mean[:, column] == pytest.approx(errors.mean(axis=0), abs=1e-3 * size)
            cosines = scipy.fft.dct(errors, axis=0, norm="ortho")[1 : COUNT // 2 + 1]
            assert one.columns.cosines[:, :, column] == pytest.approx(cosines, abs=1e-2 * size)


def test_causes_of_the_field_have_the_parameters_that_they_change_and_what_these_do_to_the_attitude():
    expected = [
        ("focal length", "focal length", ["focal length"]),
        ("distortion", "distortion", ["k1"]),
        ("distortion", "k1 and k2", ["k1", "k2"]),
        ("distortion", "tangential", ["p1", "p2"]),
        ("principal point", "principal point", ["principal point x", "principal point y"]),
        ("refraction", "refraction", ["pressure"]),
    ]
    found = [one for one in causes_of_field(model_of()) if one.cause != "pixel pitch"]
    assert [(one.cause, one.kind) for one in found] == [(cause, kind) for cause, kind, _ in expected]
    for one, (_, _, names) in zip(found, expected, strict=True):
        places = [PARAMETERS.index(name) for name in names]
        assert one.columns.field.tolist() == np.eye(len(PARAMETERS))[:, places].tolist()
        for column, place in enumerate(places):
            # frames between those that were looked at have what lies between, in a straight line
            course = np.column_stack(
                [np.interp(np.arange(COUNT), FIELD_ROWS, SHIFTS[:, axis, place]) for axis in range(3)]
            )
            assert one.columns.mean[:, column] == pytest.approx(course.mean(axis=0))
            cosines = scipy.fft.dct(course, axis=0, norm="ortho")[1 : COUNT // 2 + 1]
            assert one.columns.cosines[:, :, column] == pytest.approx(cosines, abs=1e-9)
        assert not one.is_change
        assert one.searched == 1


@pytest.mark.parametrize(("kind", "way"), [("columns", 1.0), ("rows", -1.0)])
def test_the_scale_of_one_axis_is_half_a_focal_length_and_half_a_pitch(kind, way):
    (one,) = (one for one in causes_of_field(model_of()) if (one.cause, one.kind) == ("pixel pitch", kind))
    focal, pitch = PARAMETERS.index("focal length"), PARAMETERS.index("pixel pitch")
    expected = np.zeros(len(PARAMETERS))
    expected[[focal, pitch]] = -0.5, way
    assert one.columns.field[:, 0].tolist() == expected.tolist()
    of_parts = [
        [np.interp(np.arange(COUNT), FIELD_ROWS, SHIFTS[:, axis, place]) for axis in range(3)]
        for place in (focal, pitch)
    ]
    course = (-0.5 * np.array(of_parts[0]) + way * np.array(of_parts[1])).T
    assert one.columns.mean[:, 0] == pytest.approx(course.mean(axis=0))


@pytest.mark.parametrize(
    ("value", "error", "is_allowed"),
    [(1.0, 0.02, True), (-0.5, 0.02, True), (0.93, 0.02, True), (0.85, 0.02, False), (0.0, 0.02, False),
     (1.0, 0.11, False), (2.0, 0.02, False)],
)  # fmt: skip
def test_an_origin_of_the_pixels_is_a_whole_or_half_of_one_and_known_to_a_tenth(value, error, is_allowed):
    (one,) = (one for one in constant_causes(model_of(pixel_arcsec=(50.0, 50.0))) if one.cause == "pixel origin")
    assert one.columns.mean[:, 0] == pytest.approx([50.0, 50.0, 0.0])
    assert one.allows(value, error) is is_allowed


def test_without_a_camera_there_is_no_origin_of_its_pixels():
    assert "pixel origin" not in {one.cause for one in constant_causes(model_of())}


@pytest.mark.parametrize(
    ("ppm", "is_allowed"), [(899_999.0, True), (900_100.0, False), (-8.9e6, True), (-9.1e6, False), (998e6, False)]
)
def test_a_clock_runs_ten_times_too_fast_or_too_slow_at_most(ppm, is_allowed):
    assert next(drifts(model_of())).allows(ppm, 10.0) is is_allowed


def test_without_stars_over_the_field_nothing_is_tried_of_it_and_on_a_fitted_mount_no_air():
    assert list(causes_of_field(model_of(has_field=False))) == []
    assert [one.cause for one in causes_of_field(model_of(is_fitted=True))] == [
        "focal length", *["distortion"] * 3, "principal point", *["pixel pitch"] * 2,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("air", "least_hpa", "most_hpa"),
    [
        # 1085 hPa at 180 K bend light as 1736.90 hPa at 288.15 K do, and as 1586.21 at 263.15 K.
        ({"pressure_hpa": 1000.0, "temperature_c": 15.0}, -1000.0, 736.9042),
        ({"pressure_hpa": 600.0, "temperature_c": -10.0}, -600.0, 986.2097),
    ],
)
def test_air_is_between_none_and_the_densest_on_record(air, least_hpa, most_hpa):
    *camera, of_air = causes_of_field(model_of(site=replace(SITE, **air)))
    assert of_air.bounds == pytest.approx((least_hpa, most_hpa), abs=1e-3)
    assert {one.known for one in camera} == {0.0}
    assert {one.bounds for one in camera} == {(-math.inf, math.inf), (-0.25, 0.25)}


@pytest.mark.parametrize(
    ("pressure_hpa", "temperature_k", "known_hpa"),
    [
        (0.0, 0.0, 5.0),  # half a per cent of 1000 hPa: stars are not of one colour
        (12.0, 0.0, 13.0),
        (0.0, 3.4578, math.hypot(12.0, 5.0)),  # 1.2 % of 288.15 K
        (84.0, 3.4578, 85.0),
    ],
)
def test_air_is_known_by_pressure_temperature_and_the_colour_of_stars_together(pressure_hpa, temperature_k, known_hpa):
    uncertainty = SiteUncertainty(pressure_hpa=pressure_hpa, temperature_c=temperature_k)
    *_, air = causes_of_field(model_of(site=replace(SITE, uncertainty=uncertainty)))
    assert air.known == pytest.approx(known_hpa, rel=1e-5)


def test_a_hypothesis_is_no_change_without_bounds_and_of_one_place_unless_it_says_otherwise():
    one = FineHypothesis("cause", "kind", Predictions(np.zeros((3, 2)), np.zeros((4, 3, 2)), np.zeros((8, 2))))
    assert (one.is_change, one.searched, one.bounds, one.known) == (False, 1, (-math.inf, math.inf), 0.0)
    assert (one.spacing, one.moved) == (0.0, None)
    assert math.isnan(one.at_s)
    assert math.isnan(one.place)
    assert one.cost == 10.0
    assert replace(one, searched=96).cost == pytest.approx(10.0 + 2 * math.log(96))
