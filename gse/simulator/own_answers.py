"""The simulated sensor's own answers: ATTITUDE messages of what its boresight sees, with faults.

The direction is astropy's: the places in ICRS of what is seen at the boresight through the air. It is computed at four
instants of each cell of 300 s and interpolated, as the stars are. It moves with the mount, as they do.
"""

from collections import deque

import erfa
import numpy as np
from astropy.coordinates import GCRS, FK4NoETerms, SkyCoord
from numpy.typing import NDArray

from gse.config.station import Station
from gse.simulator.scenario import AttitudeSection, Scenario
from gse.simulator.scene import horizon_to_sensor, icrs_to_sensor, moved_by
from gse.simulator.sky import CELL_NS, AstropySite, Track, earth_orientation, times_of
from gse.values.attitude_convention import AttitudeConvention, ReferenceFrame, state_angles, state_quaternions
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_S, to_julian_date
from gse.values.matrices import length, product
from protocols import AttitudeMessage

_BESIDE_RAD = 1e-3
_MATCHED = 14
_FALSE_DEG = (1.0, 40.0)
_LOST = "lost"
_J2000_TT = 2_451_545.0, 0.0
_Stretches = tuple[tuple[float, float], ...]


class OwnAnswers:
    """Answers of the device ``station``, in the convention of its own ``sensor.attitude``."""

    def __init__(self, station: Station, scenario: Scenario, random: np.random.Generator, start_ns: int) -> None:
        self._traits: AttitudeSection = scenario.attitude
        self._motion = scenario.motion
        self._convention: AttitudeConvention = station.sensor.attitude
        corrected = self._convention.aberration == "corrected"
        is_shown = station.mount.inertial is not None
        self._direction = _ShownDirection(station, scenario) if is_shown else _Direction(station, corrected=corrected)
        self._random, self._start_ns = random, start_ns
        self._earlier: deque[NDArray[np.float64]] = deque(maxlen=self._traits.delay_frames + 1)
        self._frozen: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    @property
    def processing_ns(self) -> int:
        """Time from the end of an exposure to its answer."""
        return round(self._traits.processing_ms * 1e6)

    def message(self, middle_utc_ns: int, time_us: int, frame_no: int) -> AttitudeMessage:
        """The answer to an exposure, by its middle."""
        angles, quaternion = self._numbers(middle_utc_ns)
        ra_deg, de_deg, roll_deg = angles.tolist()
        is_lost = bool(self._random.random() < self._traits.lost)
        return AttitudeMessage(
            time_us,
            0.0 if is_lost else ra_deg,
            0.0 if is_lost else de_deg,
            0.0 if is_lost else roll_deg,
            frame_no,
            0 if is_lost else _MATCHED,
            _LOST if is_lost else "acquired",
            self._traits.processing_ms / 1e3,
            *((0.0,) * 4 if is_lost else quaternion.tolist()),
        )

    def _numbers(self, utc_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """RA, DE and roll (3,), and the quaternion (4,), as they are sent."""
        measured = product(self._measured(utc_ns), _icrs_to(self._convention.frame, utc_ns).T)
        sent = state_angles(measured[None], self._convention)[0], state_quaternions(measured[None], self._convention)[0]
        since_s = (utc_ns - self._start_ns) / NS_PER_S
        if _inside(since_s, self._traits.zeros_s):
            return np.zeros(3), np.zeros(4)
        if not _inside(since_s, self._traits.frozen_s):
            self._frozen = None
            return sent
        self._frozen = self._frozen or sent
        return self._frozen

    def _measured(self, utc_ns: int) -> NDArray[np.float64]:
        """The rotation (3, 3) from ICRS to the sensor that was found, with noise, bias, delay and false answers."""
        from scipy.spatial.transform import Rotation  # a quarter of a second, for sensors with own answers only

        noise = self._random.normal(0, (*(self._traits.noise_arcsec,) * 2, self._traits.roll_noise_arcsec))
        across_x, across_y, roll = noise + self._traits.bias_arcsec
        # what lies along columns (x) is a turn about -y, along rows (y) one about x
        error = Rotation.from_rotvec(np.array([across_y, -across_x, roll]) * ARCSEC_RAD).as_matrix()
        moved = moved_by(self._motion, (utc_ns - self._start_ns) / NS_PER_S)
        self._earlier.append(product(error, moved, self._direction.icrs_to_sensor(utc_ns)))
        found = self._earlier[0]
        if self._random.random() < self._traits.false_answers:
            axis = self._random.normal(size=3)
            axis *= np.radians(self._random.uniform(*_FALSE_DEG)) / length(axis)
            found = product(Rotation.from_rotvec(axis).as_matrix(), found)
        return np.asarray(found)


class _Direction:
    """Where a fixed sensor looks among the stars: the places of what it sees, by astropy."""

    def __init__(self, station: Station, *, corrected: bool) -> None:
        self._site = AstropySite(station.site)
        self._corrected = corrected
        seen = np.array([[0, 0, 1], [_BESIDE_RAD, 0, 1], [0, _BESIDE_RAD, 1]])
        self._seen = seen / np.linalg.norm(seen, axis=1)[:, None]
        self._horizon = product(self._seen, horizon_to_sensor(station.mount))
        self._track: Track | None = None

    def icrs_to_sensor(self, utc_ns: int) -> NDArray[np.float64]:
        """The rotation (3, 3) at an instant."""
        if self._track is None or not 0 <= utc_ns - self._track.start_ns < CELL_NS:
            self._track = self._over(utc_ns // CELL_NS * CELL_NS)
        return np.asarray(product(_axes(self._seen), _axes(self._track.directions(utc_ns)).T))

    def _over(self, start_ns: int) -> Track:
        times = times_of(start_ns)[:, None]
        east, north, up = (axis[None] for axis in self._horizon.T)
        with earth_orientation():
            frame = self._site.horizon(times)
            seen = SkyCoord(
                az=np.arctan2(east, north), alt=np.arctan2(up, np.hypot(east, north)), unit="rad", frame=frame
            )
            target = "icrs"
            if self._corrected:
                place, velocity = self._site.location.get_gcrs_posvel(times)
                target = GCRS(obstime=times, obsgeoloc=place, obsgeovel=velocity)
            nodes = np.moveaxis(seen.transform_to(target).cartesian.xyz.value, 0, -1)
        return Track(start_ns, nodes / np.linalg.norm(nodes, axis=-1)[..., None])


class _ShownDirection:
    """Where a sensor before a star simulator looks: without aberration, which no convention has to correct."""

    def __init__(self, station: Station, scenario: Scenario) -> None:
        self._station, self._scenario = station, scenario

    def icrs_to_sensor(self, utc_ns: int) -> NDArray[np.float64]:
        """The rotation (3, 3) at an instant."""
        return icrs_to_sensor(self._station, self._scenario, utc_ns)


def _axes(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes in columns: z along the first of three directions (3, 3), x by the mean of what the two beside it show."""
    z = directions[0] / length(directions[0])
    along_x, along_y = (
        (beside - product(beside, z) * z) / length(beside - product(beside, z) * z) for beside in directions[1:]
    )
    x = along_x + np.cross(along_y, z)
    x /= length(x)
    return np.column_stack([x, np.cross(z, x), z])


def _icrs_to(frame: ReferenceFrame, utc_ns: int) -> NDArray[np.float64]:
    if frame == "ICRS":
        return np.eye(3)
    if frame == "J2000":
        return np.asarray(erfa.bp06(*_J2000_TT)[0])
    if frame == "B1950":
        axes = SkyCoord(*np.eye(3), representation_type="cartesian", frame="icrs")
        return np.asarray(axes.transform_to(FK4NoETerms(equinox="B1950")).cartesian.xyz.value)
    return np.asarray(erfa.pnm06a(*to_julian_date(utc_ns)))


def _inside(since_s: float, stretches: _Stretches) -> bool:
    return any(begin_s <= since_s < end_s for begin_s, end_s in stretches)
