"""The known errors that a self-check injects, one session for each."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownError:
    """A made session of a sensor that differs from its station file by what is named here.

    ``azimuth_arcsec`` is how far the boresight lies in azimuth, measured on the sky, ``poleward_arcsec`` how far
    towards the celestial pole, growing by ``poleward_arcsec_per_h`` through the middle of the session; ``roll_arcsec``
    turns image up counter-clockwise as seen in the sky; ``clock_s`` is how fast the host's clock is. ``focal_share`` is
    the error of the focal length, ``noise_px`` the standard deviation of a position on each axis, ``false_objects`` how
    many objects of each frame are not stars. The first ``blank`` of the ``frames`` of each stretch show no object.
    ``own_east_arcsec`` is how far the sensor's own answers lie to the east, None where it sends none, and the first
    ``own_false`` of each stretch are false.
    """

    name: str
    frames: int = 12
    azimuth_arcsec: float = 0.0
    poleward_arcsec: float = 0.0
    poleward_arcsec_per_h: float = 0.0
    roll_arcsec: float = 0.0
    clock_s: float = 0.0
    focal_share: float = 0.0
    noise_px: float = 0.0
    false_objects: int = 0
    blank: int = 0
    own_east_arcsec: float | None = None
    own_false: int = 0


KNOWN_ERRORS = (
    KnownError(name="no error"),
    KnownError(name="mount in azimuth", azimuth_arcsec=30.0),
    KnownError(name="boresight to the pole", poleward_arcsec=20.0),
    KnownError(name="mount drifts to the pole", poleward_arcsec_per_h=10.0),
    KnownError(name="sensor roll", roll_arcsec=600.0),
    KnownError(name="clock is fast", clock_s=0.5),
    KnownError(name="focal length", frames=4, focal_share=0.003),
    KnownError(name="position noise", frames=200, noise_px=0.2),
    KnownError(name="false objects", false_objects=3),
    KnownError(name="frames without objects", blank=1),
    KnownError(name="the sensor's own answers", own_east_arcsec=15.0, own_false=1),
)
"""Every error alone, so that what is found wrong names its cause."""
