"""Truth for the instants of a session: of the sky with the Earth's orientation, or of a star simulator.

The Earth orientation is that of the session, which is frozen with it, or is read for the date of the first panorama.
After a step of the clock beyond its reach it is sought again; for a date that is not known there is none.
"""

from drivers.chunk import LinkEvent
from gse.errors import TruthError
from gse.mount import InertialDirection
from gse.site import Site
from gse.station.event_kinds import StationKind
from gse.truth import EarthOrientation, InertialTruth, SiderealTruth
from gse.truth.iers_tables import GivenTables


class TruthSource:
    """Gives truth at the first panorama; ``given`` tables replace the installed ones, a ``frozen`` orientation both."""

    def __init__(
        self, site: Site, inertial: InertialDirection | None, frozen: EarthOrientation | None, given: GivenTables | None
    ) -> None:
        self._site, self._inertial = site, inertial
        self._is_frozen, self._given = frozen is not None, given
        self.orientation = frozen

    def at(self, utc_ns: int) -> tuple[SiderealTruth | InertialTruth | None, LinkEvent | None]:
        """Truth for an instant, None where there is none, and the event that says what it lacks, if anything."""
        if self._inertial is not None:
            return InertialTruth(self._inertial), None
        try:
            self.orientation, warning = self._found(utc_ns)
        except TruthError as error:
            return None, LinkEvent(utc_ns, 0, StationKind.NO_TRUTH, str(error))
        event = LinkEvent(utc_ns, 0, StationKind.EARTH_ORIENTATION, warning) if warning else None
        return SiderealTruth(self._site, self.orientation), event

    def reaches(self, utc_ns: int) -> bool:
        """Whether the Earth orientation at hand is good for an instant."""
        try:
            return self.orientation is not None and not self.orientation.warning(utc_ns)
        except TruthError:
            return False

    def _found(self, utc_ns: int) -> tuple[EarthOrientation, str | None]:
        """The Earth orientation for an instant, and a warning where it does not reach it."""
        at_hand = self.orientation
        if at_hand is not None and (self._is_frozen or not at_hand.warning(utc_ns)):
            return at_hand, at_hand.warning(utc_ns)
        found = EarthOrientation.from_disk(utc_ns, given=self._given)
        warning = found.warning(utc_ns)
        return (at_hand if at_hand is not None and warning else found), warning
