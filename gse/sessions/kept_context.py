"""Context of kept results: what a session holds besides the tables of frames and stars."""

from typing import Any

from pydantic import BaseModel, ConfigDict

from drivers.chunk import LinkEvent
from drivers.clock import ClockReading
from gse.catalog.names import Designation
from gse.external.identifier import ExternalCounts
from gse.station.event_kinds import ClockStep
from gse.station.results import LinkCounters, Subject
from gse.station.session_data import SessionData
from gse.truth import Alignment, EarthOrientation
from protocols import StatusMessage


class KeptContext(BaseModel):
    """Fields of SessionData, as JSON keeps them; the station is not among them, since the key names it."""

    model_config = ConfigDict(extra="forbid", ser_json_inf_nan="constants")

    protocol_name: str
    subject: Subject
    link: LinkCounters
    events: list[ClockStep | LinkEvent]
    events_not_kept: int
    others_lost: int
    clock: list[ClockReading]
    statuses: list[tuple[int, StatusMessage]]
    raw_sha256: str
    catalog: dict[str, Any]
    designation: Designation
    versions: dict[str, str]
    truncated: bool
    earth_orientation: str | None
    alignment: Alignment | None
    clock_error_s: float | None
    external: dict[str, Any] | None
    external_counts: ExternalCounts

    @classmethod
    def of(cls, session: SessionData) -> "KeptContext":
        """The context of a session."""
        orientation, stars = session.earth_orientation, session.stars
        own = {"designation", "earth_orientation"}
        values = {name: getattr(session, name) for name in cls.model_fields if name not in own}
        return cls.model_construct(
            **values,
            designation=stars.designation if stars else "Gaia DR3",
            earth_orientation=orientation.to_json() if orientation else None,
        )

    def give_to(self, session: SessionData) -> None:
        """Set the fields of a session; TruthError where the Earth orientation is none."""
        text = self.earth_orientation
        for name in type(self).model_fields:
            if name not in ("designation", "earth_orientation"):
                setattr(session, name, getattr(self, name))
        session.earth_orientation = EarthOrientation.from_json(text) if text is not None else None
