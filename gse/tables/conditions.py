"""Conditions of a session as columns: sky, air, link, mount, camera, and what was excluded."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gse import instant
from gse.camera import Camera
from gse.identifier_options import IdentifierOptions
from gse.limits import Limits
from gse.mount import Mount
from gse.site import Site
from gse.station.columns import COLUMNS
from gse.station.results import LinkCounters
from gse.station.session_data import SessionData
from gse.statistics.session_statistics import Statistics
from gse.statistics.sky_summary import sky_summary
from gse.tables.records import COUNT, FLAG, NUMBER, TEXT, Column, column, columns_of, records
from gse.tables.units import joined

_RANGE = (("min", 0), ("median", 50), ("max", 100))
"""Names of percentiles."""


@dataclass(frozen=True, slots=True)
class NamedCount:
    """How many of what."""

    name: str
    count: int


@dataclass(frozen=True, slots=True)
class ExcludedStretch:
    """A stretch that the statistics leave out, with its frames; instants in RFC 3339."""

    from_utc: str
    until_utc: str
    cause: str
    reason: str
    frames: int


def conditions(session: SessionData | None, stats: Statistics | None) -> Iterator[Column]:
    """The columns of the conditions; null without a session."""
    station = session.station if session else None
    for ranged in COLUMNS:
        if ranged.ranged:
            yield from _range(ranged.name, session.frames.columns[ranged.name] if session else np.zeros(0))
    yield column("sky_condition", TEXT, _sky_condition(session) if session else None)
    yield records(ExcludedStretch, _stretches(stats) if stats else None, "exclusions")
    yield from _link(session)
    yield from columns_of(Site, station.site if station else None, "site")
    yield from _mount(session)
    yield from columns_of(Camera, station.sensor.camera() if station else None, "camera")
    yield from columns_of(IdentifierOptions, station.identifier if station else None, "identifier")
    yield from columns_of(Limits, station.limits if station else None, "limit")
    for name, kind in (("source", TEXT), ("stars", COUNT), ("sha256_of_ids", TEXT), ("epoch_jyear", NUMBER)):
        yield column(f"catalog_{name}", kind, session.catalog.get(name) if session else None)


def _sky_condition(session: SessionData) -> str | None:
    """The condition of the sky in most frames."""
    summary = sky_summary(session.frames.columns)
    return summary.condition.value if summary else None


def _range(name: str, values: NDArray[np.generic]) -> Iterator[Column]:
    """Least, median and greatest of the known values of a column."""
    numbers = values.astype(np.float64)
    known = numbers[np.isfinite(numbers)]
    for word, percent in _RANGE:
        yield column(joined(name, word), NUMBER, float(np.percentile(known, percent)) if len(known) else None)


def _stretches(stats: Statistics) -> list[ExcludedStretch]:
    return [
        ExcludedStretch(
            instant.to_text(item.from_ns), instant.to_text(item.until_ns), item.cause.value, item.reason, frames
        )
        for item, frames in stats.exclusions
    ]


def _link(session: SessionData | None) -> Iterator[Column]:
    by_reason = "discarded_bytes_by_reason"
    yield from columns_of(LinkCounters, session.link if session else None, "link", without=(by_reason,))
    yield records(NamedCount, _counts(session.link.discarded_bytes_by_reason) if session else None, f"link_{by_reason}")
    yield column("truncated", FLAG, session.truncated if session else None)
    kinds = Counter(str(event.kind) for event in session.events) if session else {}
    yield records(NamedCount, _counts(kinds) if session else None, "events")
    yield column("clock_stated_error_s", NUMBER, session.clock_error_s if session else None)


def _counts(counts: Mapping[str, int]) -> Iterable[NamedCount]:
    return [NamedCount(name, count) for name, count in sorted(counts.items())]


def _mount(session: SessionData | None) -> Iterator[Column]:
    """The mount in force; where it was fitted on the session itself also its standard deviations."""
    fit = session.alignment if session else None
    mount = fit.mount if fit else session.station.mount if session else None
    yield from columns_of(Mount, mount, "mount")
    yield column("mount_fit_frames", pa.int64(), fit.n if fit else None)
    is_known = fit is not None and bool(np.isfinite(fit.covariance_arcsec2).all())
    sigmas_arcsec = fit.sigma_azimuth_altitude_roll_arcsec if fit and is_known else (None, None, None)
    for angle, sigma_arcsec in zip(("azimuth", "altitude", "roll"), sigmas_arcsec, strict=True):
        yield column(f"mount_fit_sigma_{angle}_arcsec", NUMBER, sigma_arcsec)
