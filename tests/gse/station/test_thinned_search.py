"""Frames without stars: the whole sky is searched now and then, where the sensor looked always."""

import numpy as np
import pytest
from numpy.typing import NDArray
from skies.made_frames import FIELD_14_DEG, Noise, made_frame, sky_of

from gse.catalog import load_catalog
from gse.identifier import Answers, Identification, ObjectColumns
from gse.identifier.robust import RobustIdentifier
from gse.station.thinned_search import EVERY, FIRST_FRAMES, ThinnedSearch
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import InertialDirection, Mount
from gse.values.site import Site

SITE = Site(latitude_deg=-6.5, longitude_deg=106.8)
ZENITH = Mount()
START = from_text("2026-03-20T15:00:00Z")
Frame = tuple[NDArray[np.float64], NDArray[np.float64]]


@pytest.fixture(scope="module")
def robust() -> RobustIdentifier:
    return RobustIdentifier(FIELD_14_DEG, load_catalog())


@pytest.fixture(scope="module")
def sky():
    return sky_of(load_catalog(), FIELD_14_DEG, 6.0)


def lamps(count: int, seed: int = 1) -> list[Frame]:
    """Frames of 30 objects at random places."""
    random = np.random.default_rng(seed)
    return [
        (FIELD_14_DEG.directions(random.uniform(0, 1023, (30, 2))), np.sort(random.uniform(100, 4000, 30))[::-1])
        for _ in range(count)
    ]


def looked_at(mount: Mount, seconds: float, site: Site = SITE) -> NDArray[np.float64]:
    utc_ns = START + round(seconds * NS_PER_S)
    return SiderealTruth(site, EarthOrientation.from_disk(utc_ns)).attitude_true(utc_ns, mount).boresight_icrs


def field(sky, direction: NDArray[np.float64], seed: int = 1) -> Frame:
    made = made_frame(sky, FIELD_14_DEG, direction, Noise(), np.random.default_rng(seed))
    return FIELD_14_DEG.directions(made.xy_px), made.brightness


def answers_of(
    search: ThinnedSearch,
    frames: list[Frame],
    *,
    step_s: float = 0.1,
    cut: int = 10_000,
    answered: tuple[int, ...] = (),
) -> tuple[Answers, list[tuple[int, str]]]:
    """The answers to frames that come in parts of ``cut``."""
    utc_ns = START + (np.arange(len(frames)) * step_s * NS_PER_S).astype(np.int64)
    checked = np.isin(np.arange(len(frames)), answered)
    found, said = [], []
    for begin in range(0, len(frames), cut):
        end = min(begin + cut, len(frames))
        part = ObjectColumns.from_panoramas(frames[begin:end])
        answers, words = search.identify_many(part, utc_ns[begin:end], checked[begin:end])
        found.append(answers)
        said += [(begin + k, text) for k, text in words]
    return Answers.joined(found), said


def told(answers: Answers) -> list[object]:
    return [
        (one.objects.tolist(), one.stars.tolist(), one.false_match_probability)
        if isinstance(one, Identification)
        else one
        for one in answers
    ]


def test_the_first_frame_with_stars_after_many_without_is_named_as_ever(robust: RobustIdentifier, sky) -> None:
    """The sky has turned by 15 deg meanwhile; the mount is not known."""
    dark = FIRST_FRAMES + EVERY + 5
    frames = [field(sky, looked_at(ZENITH, 0)), *lamps(dark), field(sky, looked_at(ZENITH, 3600))]
    answers, said = answers_of(ThinnedSearch(robust, SITE, None), frames, step_s=3600 / (dark + 1))
    assert np.flatnonzero(answers.named).tolist() == [0, dark + 1]
    whole = robust.identify(*frames[dark + 1])
    assert isinstance(whole, Identification)
    assert set(answers[dark + 1].stars) == set(whole.stars)
    words = (
        f"{dark} frames in a row showed no stars: the whole sky was searched in the first {FIRST_FRAMES} and in 1 of "
        f"the other {dark - FIRST_FRAMES}, the sky around the last answer in all"
    )
    assert said == [(dark + 1, words)]


def test_without_an_answer_before_the_stated_mount_says_where_to_look(robust: RobustIdentifier, sky) -> None:
    for mount in (
        ZENITH,
        Mount(azimuth_deg=200, altitude_deg=35),
        Mount(inertial=InertialDirection(ra_deg=80, de_deg=5)),
    ):
        if mount.inertial is None:
            direction = looked_at(mount, 40 * 60)
        else:
            ra, de = np.radians([80, 5])
            direction = np.array([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
        frames = [*lamps(40), field(sky, direction)]
        answers, _ = answers_of(ThinnedSearch(robust, SITE, mount), frames, step_s=60)
        assert np.flatnonzero(answers.named).tolist() == [40]


def test_a_sensor_that_was_turned_is_found_by_the_next_whole_search(robust: RobustIdentifier, sky) -> None:
    elsewhere = field(sky, looked_at(Mount(azimuth_deg=90, altitude_deg=20), 0))
    frames = [field(sky, looked_at(ZENITH, 0)), *lamps(FIRST_FRAMES + 20), *[elsewhere] * EVERY]
    answers, said = answers_of(ThinnedSearch(robust, SITE, ZENITH), frames)
    named = np.flatnonzero(answers.named)[1:]
    assert named[0] == FIRST_FRAMES + EVERY
    assert np.diff(named).max() == 1  # from there on all are searched
    assert [k for k, _ in said] == [FIRST_FRAMES + EVERY]


@pytest.mark.parametrize("cut", [1, 7, 33])
def test_the_answers_are_the_same_however_the_frames_come(robust: RobustIdentifier, sky, cut: int) -> None:
    clear, lost = field(sky, looked_at(ZENITH, 0)), field(sky, looked_at(Mount(azimuth_deg=90, altitude_deg=20), 0))
    few: Frame = (clear[0][:2], clear[1][:2])
    frames = [clear, *lamps(FIRST_FRAMES), few, lost, clear, *lamps(130, seed=2), clear, lost]
    whole, of_whole = ThinnedSearch(robust, SITE, ZENITH), ThinnedSearch(robust, SITE, ZENITH)
    one, other = answers_of(whole, frames), answers_of(of_whole, frames, cut=cut)
    assert told(one[0]) == told(other[0])
    assert one[1] == other[1]
    assert whole.finish() == of_whole.finish()


def test_a_frame_that_another_identifier_answered_is_always_searched(robust: RobustIdentifier, sky) -> None:
    elsewhere = field(sky, looked_at(Mount(azimuth_deg=90, altitude_deg=20), 0))
    frames = [*lamps(30), elsewhere, elsewhere]
    answers, _ = answers_of(ThinnedSearch(robust, SITE, ZENITH), frames, answered=(31,))
    assert np.flatnonzero(answers.named).tolist() == [31]


def test_mirrored_frames_are_all_searched(robust: RobustIdentifier, sky) -> None:
    """They name the mistake, and are no frames without stars."""
    directions, brightness = field(sky, looked_at(ZENITH, 0))
    frames = [(directions * [-1.0, 1.0, 1.0], brightness)] * (2 * FIRST_FRAMES)
    answers, said = answers_of(ThinnedSearch(robust, SITE, ZENITH), frames)
    assert {one.reason.value for one in answers.unidentified.values()} == {"MIRRORED"}
    assert (len(answers.unidentified), said) == (len(frames), [])


def test_a_stretch_at_the_end_of_a_session_is_told_too(robust: RobustIdentifier) -> None:
    search = ThinnedSearch(robust, SITE, ZENITH)
    answers, said = answers_of(search, lamps(FIRST_FRAMES + EVERY + 5))
    assert (answers.named.sum(), said) == (0, [])
    assert f"{FIRST_FRAMES + EVERY + 5} frames in a row showed no stars" in (search.finish() or "")
    assert search.finish() is None
    assert answers.unidentified[FIRST_FRAMES + 3].detail.startswith("no stars where the sensor looked before")
