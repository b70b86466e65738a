"""The error atlas finds errors that were put in, in one night of 8 h, and none where there are none."""

import numpy as np
import pytest
from skies.drifting_stars import drifting_stars

from gse.campaign import atlas
from gse.campaign.atlas import AtlasResiduals, left_out, session_atlas, sigmas_of
from gse.campaign.star_places import SIGMAS, named_stars, star_offsets, to_sky
from gse.catalog import load_catalog

SHIFT_ARCSEC = 20.0
PHASE_PX = 0.05


def found_in(**options):
    """The atlas of a drifting field, significance of its pixel phases, and its stars."""
    made = drifting_stars(8.0, step_s=4.0, start_deg=80.0, **options)
    of = AtlasResiduals(
        made.residual, made.xy_px, made.phase_px, made.field_deg, made.star, made.frame, made.size_px, made.pixel_arcsec
    )
    freed, useful = of.without_own_share()
    found = session_atlas(freed)
    assert found is not None
    atlas, fitted_arcsec = found
    sky = to_sky(of.residuals_arcsec[useful] - fitted_arcsec, freed.field_deg, made.boresight_deg[useful])
    stars = named_stars([star_offsets(sky, freed.star, freed.frame, made.utc_ns[useful])])
    phases = [
        sigmas_of(float(one.harmonic_px @ np.linalg.solve(one.covariance_px2, one.harmonic_px)), 2)
        for one in atlas.phase
    ]
    return atlas, phases, stars


@pytest.fixture(scope="module")
def blended() -> int:
    """A bright star in the middle of the field's way."""
    catalog = load_catalog(stars=6000)
    ra, de = (
        np.degrees(np.arctan2(catalog.icrs[:, 1], catalog.icrs[:, 0])) % 360,
        np.degrees(np.arcsin(catalog.icrs[:, 2])),
    )
    return int(np.flatnonzero((np.abs(ra - 130) < 15) & (np.abs(de + 6.5) < 4))[0])


@pytest.mark.parametrize("whole_pixels", [False, True])
def test_a_pixel_phase_error_and_a_blend_are_found_in_one_night(whole_pixels, blended):
    atlas, phases, stars = found_in(
        phase_px=(PHASE_PX, 0.0), blend=(blended, SHIFT_ARCSEC, 0.0), whole_pixels=whole_pixels
    )
    assert phases[0] > SIGMAS
    assert phases[1] < SIGMAS
    assert atlas.phase[0].harmonic_px[0] == pytest.approx(PHASE_PX, abs=0.02)
    assert [star.star for star in stars if star.sigmas > SIGMAS] == [blended]
    assert (stars[0].east_arcsec, stars[0].north_arcsec) == pytest.approx((SHIFT_ARCSEC, 0.0), abs=2.0)


def test_a_perfect_sensor_with_whole_pixels_shows_no_error_but_that_of_rounding():
    atlas, phases, stars = found_in(whole_pixels=True, seed=2)
    assert max(phases) < SIGMAS
    assert max(star.sigmas for star in stars) < SIGMAS
    assert atlas.field_sigmas < SIGMAS
    assert abs(atlas.scale) < 4 * atlas.scale_error
    assert np.abs(atlas.phase[0].curve_px).max() > 0.05


def test_a_longer_focal_length_is_found_with_its_sign():
    atlas, _, _ = found_in(focal_length_error=2e-4)
    assert atlas.scale == pytest.approx(2e-4, rel=0.1)


def test_east_and_north_are_those_of_the_sky():
    """At DE 0 with roll 0 the image has north up, that is towards smaller rows, and east left."""
    east, north = to_sky(np.array([[-3.0, -5.0]]), np.zeros((1, 2)), np.array([[10.0, 0.0, 0.0]]))[0]
    assert (east, north) == pytest.approx((3.0, 5.0))
    east, north = to_sky(np.array([[0.0, -5.0]]), np.zeros((1, 2)), np.array([[10.0, 40.0, 90.0]]))[0]
    assert (east, north) == pytest.approx((5.0, 0.0), abs=1e-9)


def test_stars_are_freed_of_their_own_share_in_parts_as_all_together(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    frame = np.repeat([2, 3, 7, 8, 40, 41], [9, 1, 12, 5, 30, 8])
    stars = rng.normal(0, 5, (len(frame), 2)), rng.uniform(-6, 6, (len(frame), 2)), frame
    together = left_out(*stars)
    for most in (1, 10, 31):
        monkeypatch.setattr(atlas, "_ROWS_AT_ONCE", most)
        for one, other in zip(left_out(*stars), together, strict=True):
            np.testing.assert_array_equal(one, other)
