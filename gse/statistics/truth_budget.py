"""The truth uncertainty budget: each input of the truth, how well it is known, and what that leaves open.

For the verdict: ``truth_budget(session_facts(session, clock_error_s=...))`` gives a TruthUncertaintyBudget; its
``axes``, by the key of each of AXES, are AxisUncertainty (standard, expanded with k, one-sided 95 %, the part that
is common to all frames and the part that changes with the field, and whether all terms are known), ``terms`` the rows
of the report, and ``complaint`` a sentence where it is too much for a limit.

Sensitivities are finite differences of SiderealTruth: the truth of the session's middle is taken again with an input
that is changed by one standard uncertainty. Numbers in the station file under ``uncertainty`` are half-widths of 95 %
(k = 2), as certificates and GPS receivers state them. A mount that was fitted on the session's own sky takes up every
error that is constant in the horizon frame: site, vertical, refraction at the boresight, UT1, time stamp. What mount
or clock do in the session is in the errors that are seen, so it counts in their sampling (gse.statistics.sampling).
docs/uncertainty.md explains each term and its default.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from drivers.second_port import passing_bound_s
from gse.station.host_clock import instants_ns
from gse.station.own_answers import by_other_stars_arcsec
from gse.station.session_data import SessionData, middle_instant_ns
from gse.statistics.budget_terms import (
    OWN_FRAME,
    ChangedTruth,
    air_terms,
    answers_frame,
    clock,
    earth_terms,
    fitted_mount,
    inertial_terms,
    model_terms,
    screen_terms,
    site_terms,
    stated_mount,
    time_terms,
)
from gse.statistics.star_terms import OWN_STARS, FieldOfStars, own_stars, star_terms
from gse.statistics.uncertainty import AxisUncertainty, Term, combined
from gse.truth import Alignment, EarthOrientation
from gse.values.attitude_convention import AnswerRotation
from gse.values.axis import AXES, D_DE, D_RA_COSDE, Axis
from gse.values.mount import Mount
from gse.values.screen import Screen, ShownSky
from gse.values.site import Site
from protocols.description import DelayDescription, TimeDescription

_USUAL_FIELD = FieldOfStars()
_NO_DELAY = DelayDescription(value=0.0, uncertainty=0.0)
_NO_DELAY_TIME = TimeDescription(delay_ms=_NO_DELAY)


@dataclass(frozen=True, slots=True)
class SessionFacts:
    """What the budget is made from: the instant is the session's middle.

    ``alignment`` is the mount where it was fitted on other frames of the session. ``clock_by`` says whose bound that of
    the clock is. ``own_stars_arcsec`` is what its choice of stars makes of the sensor's own answers (0: it sent none).
    ``time`` says what the time tags tell; a polled exposure may be ``poll_period_s`` older than it seems; passing bytes
    on took up to ``passing_s``. ``screen`` is what stood before the sensor, and ``shown`` what it showed.
    ``answers`` is how the frame of its own answers sits on the sensor.
    """

    site: Site
    mount: Mount
    earth_orientation: EarthOrientation | None
    utc_ns: int
    clock_error_s: float
    stars: FieldOfStars = _USUAL_FIELD
    baudrate: int = 115_200
    duration_s: float = 0.0
    alignment: Alignment | None = None
    own_stars_arcsec: float = 0.0
    clock_by: str = ""
    time: TimeDescription = _NO_DELAY_TIME
    poll_period_s: float = 0.0
    passing_s: float = 0.0
    screen: Screen | None = None
    shown: ShownSky = field(default_factory=ShownSky)
    answers: AnswerRotation | None = None


@dataclass(frozen=True, slots=True)
class TruthUncertaintyBudget:
    """All terms of a session, and what they leave open together, by axis.

    ``own_axes`` are those of the sensor's own answers, which have a term more.
    """

    terms: tuple[Term, ...]
    axes: dict[str, AxisUncertainty]
    own_axes: dict[str, AxisUncertainty]

    @property
    def ra_arcsec(self) -> float:
        """The expanded uncertainty (95 %) in dRA*."""
        return self.axes[D_RA_COSDE.key].expanded_arcsec

    @property
    def de_arcsec(self) -> float:
        """The expanded uncertainty (95 %) in dDE."""
        return self.axes[D_DE.key].expanded_arcsec

    def complaint(self, axis: Axis, limit_arcsec: float, share: float, *, own: bool = False) -> str | None:
        """One line where the expanded uncertainty on an axis is above a limit / ``share``, else None.

        ``own``: that of the sensor's own answers.
        """
        total = (self.own_axes if own else self.axes)[axis.key].expanded_arcsec
        if total * share <= limit_arcsec:
            return None
        terms = [term for term in self.terms if own or term.name not in (OWN_STARS, OWN_FRAME)]
        alone = {term: combined([term], axis).expanded_arcsec for term in terms}
        large = sorted((term for term in alone if alone[term] >= total / 2), key=alone.__getitem__, reverse=True)
        remark = f"; {large[0].remedy}" if large and large[0].remedy else ""
        of = f"the sensor's {axis.label}" if own else axis.label
        if not math.isfinite(total):
            unknown = " and ".join(term.name for term in large if not math.isfinite(alone[term]))
            return f"{of}: it cannot be judged, because the error of the {unknown} is not known{remark}"
        names = " and ".join(f"{term.name} ({alone[term]:.1f} arcsec)" for term in large) or "all terms together"
        return (
            f"{of}: truth is known to {total:.1f} arcsec only, because of {names}; a third of the limit is "
            f"{limit_arcsec / share:.3g} arcsec{remark}"
        )


def session_facts(session: SessionData, *, clock_error_s: float, clock_by: str = "") -> SessionFacts:
    """The facts of a session; ``clock_error_s`` is the bound that clock_health found (inf: not known)."""
    frames, station = session.frames.columns, session.station
    utc_ns, middle_ns = instants_ns(frames, session.events), middle_instant_ns(session)
    return SessionFacts(
        site=station.site,
        mount=session.alignment.mount if session.alignment else station.mount,
        earth_orientation=session.earth_orientation if middle_ns is not None else None,
        utc_ns=middle_ns or 0,
        clock_error_s=clock_error_s,
        stars=FieldOfStars.from_session(session),
        baudrate=station.port.baudrate,
        duration_s=float(np.ptp(utc_ns)) / 1e9 if len(frames) else 0.0,
        alignment=session.alignment,
        own_stars_arcsec=by_other_stars_arcsec(session) if len(session.sensor_attitudes) else 0.0,
        clock_by=clock_by,
        time=_time(session),
        poll_period_s=_poll_period_s(session),
        passing_s=passing_bound_s(session.events),
        screen=station.screen,
        shown=session.shown.only(lambda item: item.rate_deg_per_s <= (station.limits.slew_deg_per_s or math.inf)),
        answers=station.sensor.attitude.rotation if len(session.sensor_attitudes) else None,
    )


def _time(session: SessionData) -> TimeDescription:
    """As the session has it; a simulated sensor and the bytes of a raw capture have no delay of their own."""
    is_raw = len(session.frames) > 0 and not (session.frames.columns["host_utc_ns"] > 0).any()
    if session.time.delay_ms is None and (session.is_simulated or is_raw):
        return session.time.model_copy(update={"delay_ms": _NO_DELAY})
    return session.time


def _poll_period_s(session: SessionData) -> float:
    """How long before its request a polled panorama may have been taken, where its tag does not show it."""
    poll = session.station.sensor.poll
    if poll is None or session.time.scale != "host" or session.is_simulated:
        return 0.0
    return (poll.timeout_ms if poll.period_ms == "asap" else float(poll.period_ms)) / 1000


def truth_budget(facts: SessionFacts) -> TruthUncertaintyBudget:
    """The budget of a session; without Earth orientation there is no truth, and one unknown term says so."""
    if facts.screen is not None:
        terms = tuple(screen_terms(facts.screen, facts.shown))
    elif facts.mount.inertial is not None:
        terms = tuple(inertial_terms(facts.mount.inertial, facts.clock_error_s))
    elif facts.earth_orientation is None:
        terms = (_no_truth(),)
    else:
        terms = tuple(_terms(facts, facts.earth_orientation))
    if facts.answers is not None:
        terms = (*terms, answers_frame(facts.answers.uncertainty_arcsec))
    if facts.clock_by:
        terms = tuple(
            replace(term, evidence=f"B: {facts.clock_by}") if term.name == "clock" else term for term in terms
        )
    common = [term for term in terms if term.name not in (OWN_STARS, OWN_FRAME)]
    axes, own_axes = ({axis.key: combined(some, axis) for axis in AXES} for some in (common, terms))
    return TruthUncertaintyBudget(terms, axes, own_axes)


def _no_truth() -> Term:
    return Term(
        "sidereal truth",
        math.inf,
        "",
        math.inf,
        math.inf,
        math.inf,
        evidence="none",
        explanation="nothing was compared with the sky",
        remedy="see the events for why",
    )


def _terms(facts: SessionFacts, orientation: EarthOrientation) -> list[Term]:
    at = ChangedTruth(facts.site, facts.mount, orientation, facts.utc_ns)
    constant = [
        *earth_terms(orientation, facts.utc_ns, at),
        *site_terms(facts.site, at),
        *air_terms(facts.site, facts.mount, at),
        *time_terms(facts.time, facts.baudrate, facts.poll_period_s, facts.passing_s, at),
    ]
    if facts.alignment is None:
        mount = stated_mount(facts.mount, at)
    else:
        constant = [_absorbed(term) for term in constant]
        mount = [fitted_mount(facts.alignment, at)]
    stars = star_terms(facts.stars, facts.utc_ns, facts.duration_s)
    if facts.own_stars_arcsec:
        stars.append(own_stars(facts.own_stars_arcsec, facts.stars.width_rad))
    clocks = [] if facts.time.is_absolute else [clock(facts.clock_error_s, at)]
    return [*model_terms(at), *constant, *mount, *clocks, *stars]


def _absorbed(term: Term) -> Term:
    """An error that is constant in the horizon frame is part of a mount that was fitted under it."""
    return replace(
        term, ra_arcsec=0.0, de_arcsec=0.0, roll_arcsec=0.0, absorbed=True, remedy="absorbed by the fitted mount"
    )
