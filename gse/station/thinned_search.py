"""Search of the reference identifier through the frames of a session, thinned out where none shows stars.

A frame whose objects are no stars (lamps in cloud, hot pixels) costs the search of the whole sky, 10 to 60 ms; an
overcast night has a hundred thousand of them. So after FIRST_FRAMES such frames in a row the whole sky is searched in
one frame of EVERY. All others are searched where the sensor may be looking: where the session's last answer was, where
the turning Earth has taken that place, and where the stated mount looks. A star field there is found by the same
search and believed on the same evidence; then all frames are searched as before. A frame that the identifier under
test answers is always searched, since its answer is checked.

All is decided by the frames in their order, never by a clock: a session gives the same answers however it is cut.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.identifier import Answers, Identification, ObjectColumns, Reason, Unidentified
from gse.identifier.robust import RobustIdentifier
from gse.values.attitude import solve_attitude
from gse.values.constants import DAY_S, EARTH_RATE_RAD_PER_S, EARTH_TURNS_PER_UT1_DAY, J2000_NS
from gse.values.instant import NS_PER_S
from gse.values.mount import Mount
from gse.values.site import Site

FIRST_FRAMES = 16
"""Frames without stars that are all searched over the whole sky: a sensor in haze is named once in a few frames."""

EVERY = 200
"""Of the frames that follow, the whole sky is searched in one of so many: for a sensor that was turned meanwhile, and
whose own identifier gives no answer either."""

_AROUND_RAD = math.radians(3.0)
"""What a mount may be turned by, or stated wrong, and be found at once."""
_BUILT_WITHIN_RAD = math.radians(1.0)
"""The sky turns by this in 4 minutes; then the part that is searched is chosen anew."""

_NOT_SEARCHED = Unidentified(
    Reason.NO_MATCH,
    f"no stars where the sensor looked before; after {FIRST_FRAMES} frames without stars the whole sky is searched in "
    f"one of {EVERY}",
)


@dataclass(frozen=True, slots=True)
class _Fix:
    """The objects of a frame that are stars, and which: where the sensor looked at an instant."""

    directions_sensor: NDArray[np.float64]
    stars_icrs: NDArray[np.float64]
    utc_ns: int


class ThinnedSearch:
    """The reference identifier in a session; it takes the panoramas in their order."""

    def __init__(self, identifier: RobustIdentifier, site: Site, mount: Mount | None) -> None:
        self.identifier = identifier
        self._site, self._mount = site, mount
        self._hopeless = self._since = 0
        self._thinned = self._searched = 0
        self._fix: _Fix | None = None
        self._near: tuple[NDArray[np.float64], RobustIdentifier] | None = None

    def identify_many(
        self, objects: ObjectColumns, utc_ns: NDArray[np.int64], answered: NDArray[np.bool_]
    ) -> tuple[Answers, list[tuple[int, str]]]:
        """The answers to the K panoramas that come next, at ``utc_ns`` (K,), and what ended before which of them.

        ``answered`` (K,) are those that another identifier has answered.
        """
        found: list[Answers] = []
        said: list[tuple[int, str]] = []
        begin = 0
        while begin < len(objects):
            is_thinned, is_whole = self._hopeless >= FIRST_FRAMES, True
            end = begin + 1 if is_thinned else min(begin + FIRST_FRAMES - self._hopeless, len(objects))
            part = objects.part(begin, end)
            if is_thinned:
                is_whole = self._is_due(answered=bool(answered[begin]))
                answers = self.identifier.identify_many(part) if is_whole else self._near_answers(part, utc_ns[begin])
            else:
                answers = self.identifier.identify_many(part)
            self._count(answers, part, utc_ns[begin:end])
            if is_thinned and self._hopeless:
                self._thinned += 1
                self._searched += is_whole
            elif words := self.finish():
                said.append((begin, words))
            found.append(answers)
            begin = end
        return Answers.joined(found), said

    def finish(self) -> str | None:
        """The words on the stretch that is at its end, if there was one."""
        thinned, searched = self._thinned, self._searched
        self._thinned = self._searched = 0
        if not thinned:
            return None
        return (
            f"{FIRST_FRAMES + thinned} frames in a row showed no stars: the whole sky was searched in the first "
            f"{FIRST_FRAMES} and in {searched} of the other {thinned}, the sky around the last answer in all"
        )

    def _is_due(self, *, answered: bool) -> bool:
        """Whether the whole sky is searched for the panorama that comes next, after many without stars."""
        self._since += 1
        is_due = answered or self._since == EVERY
        self._since = 0 if is_due else self._since
        return is_due

    def _near_answers(self, one: ObjectColumns, utc_ns: np.int64) -> Answers:
        """The answer to one panorama that is searched where the sensor may be looking."""
        near = self._identifier_near(int(utc_ns))
        if near is None:
            return Answers.from_answers([_NOT_SEARCHED])
        answers = near.identify_many(one)
        return answers.but({k: _NOT_SEARCHED for k, answer in answers.unidentified.items() if _is_hopeless(answer)})

    def _count(self, answers: Answers, objects: ObjectColumns, utc_ns: NDArray[np.int64]) -> None:
        """Count the frames without stars up to the latest, and keep the last answer."""
        for k in range(len(answers)):
            answer = answers.unidentified.get(k)
            if answer is None or answer.reason in (Reason.AMBIGUOUS, Reason.MIRRORED):
                self._hopeless = self._since = 0
            elif _is_hopeless(answer):
                self._hopeless += 1
        named = np.flatnonzero(answers.named)
        if len(named):
            last = answers[k := int(named[-1])]
            assert isinstance(last, Identification)
            directions = objects.directions_sensor[objects.parts.rows(k)]
            self._fix = _Fix(directions[last.objects], self.identifier.catalog.icrs[last.stars], int(utc_ns[k]))

    def _identifier_near(self, utc_ns: int) -> RobustIdentifier | None:
        """The identifier for where the sensor may be looking; None where nothing tells."""
        places = self._places(utc_ns)
        if not len(places):
            return None
        if self._near is None or not _are_near(places, self._near[0]):
            reach_rad = self.identifier.field_radius_rad + _AROUND_RAD
            self._near = places, self.identifier.around(places, reach_rad)
        return self._near[1]

    def _places(self, utc_ns: int) -> NDArray[np.float64]:
        """Directions (P, 3) in ICRS."""
        places = []
        if self._fix is not None:
            looked = solve_attitude(self._fix.directions_sensor, self._fix.stars_icrs, 1e-4).boresight_icrs
            turned_rad = EARTH_RATE_RAD_PER_S * ((utc_ns - self._fix.utc_ns) / NS_PER_S)
            places += [looked, _turned(looked, turned_rad)]
        if self._mount is not None:
            places.append(_looked_at(self._mount, self._site, utc_ns))
        return np.array(places).reshape(-1, 3)


def _is_hopeless(answer: Unidentified) -> bool:
    return answer.reason is Reason.NO_MATCH


def _are_near(places: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    chord = 2 * math.sin(_BUILT_WITHIN_RAD / 2)
    return places.shape == others.shape and bool((((places - others) ** 2).sum(axis=1) < chord**2).all())


def _turned(direction: NDArray[np.float64], angle_rad: float) -> NDArray[np.float64]:
    """A direction turned about the pole, towards growing right ascension."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    x, y, z = direction.tolist()
    return np.array([c * x - s * y, s * x + c * y, z])


_ERA_AT_J2000_TURNS = 0.7790572732640
"""The Earth rotation angle of the IAU 2000; with UTC for UT1, and the axes of the date for ICRS: 0.2 deg off."""


def _looked_at(mount: Mount, site: Site, utc_ns: int) -> NDArray[np.float64]:
    """Where a mount looks, as it is stated, to a part of a degree."""
    if mount.inertial is not None:
        ra, de = math.radians(mount.inertial.ra_deg), math.radians(mount.inertial.de_deg)
        return np.array([math.cos(de) * math.cos(ra), math.cos(de) * math.sin(ra), math.sin(de)])
    azimuth, altitude = math.radians(mount.azimuth_deg), math.radians(mount.altitude_deg)
    latitude = math.radians(site.latitude_deg)
    north, east = math.cos(altitude) * math.cos(azimuth), math.cos(altitude) * math.sin(azimuth)
    up = math.sin(altitude)
    on_meridian = np.array(
        [
            up * math.cos(latitude) - north * math.sin(latitude),
            east,
            up * math.sin(latitude) + north * math.cos(latitude),
        ]
    )
    days = (utc_ns - J2000_NS) / NS_PER_S / DAY_S
    turns = _ERA_AT_J2000_TURNS + days * EARTH_TURNS_PER_UT1_DAY
    return _turned(on_meridian, 2 * math.pi * turns + math.radians(site.longitude_deg))
