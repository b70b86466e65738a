"""Causes injected into nights of astropy's alone: how often the right one is named, a wrong one, or none.

Each night has one thing wrong (tests/skies/wrong_night.py). The size of a fine cause is a number of standard errors:
those that the fit of a great one of its kind has in the same night, by itself. Whole pixels and centroids, fields of
8 to 30 deg, altitudes of 35 to 89.5 deg, sessions of 60 s to 2 h, four sites.

    python benchmarks/causes.py fine --sessions 3 --sigmas 6 [--only "clock step"]
    python benchmarks/causes.py clean --sessions 100 [--wander]
    python benchmarks/causes.py gross
"""

import argparse
import itertools
import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gse.diagnosis import fine_causes
from gse.diagnosis.diagnosis import session_model
from gse.diagnosis.fine_causes import causes_of_field, constant_causes, drifts, sinusoids, steps
from gse.diagnosis.session_model import SessionModel
from gse.diagnosis.turns import pole
from gse.station.events import Finding
from gse.statistics.session_statistics import statistics
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.site import Site
from gse.verdict.assessment import judge

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from skies.wrong_night import Plan, World, session


def _site(latitude, longitude, height, pressure, temperature):
    return Site(
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        pressure_hpa=pressure,
        temperature_c=temperature,
    )


SITES = (
    (_site(48.2, 11.6, 500.0, 955.0, 8.0), "2026-03-20T{}:30:00Z", ("19", "20", "21", "22", "23")),
    (_site(-33.3, -70.2, 2400.0, 760.0, 5.0), "2026-06-15T{}:10:00Z", ("00", "01", "02", "03", "04", "05", "06")),
    (_site(-77.8, 179.6, 40.0, 985.0, -25.0), "2026-07-10T{}:05:00Z", ("10", "11", "12", "13", "14")),
    (_site(71.3, -179.4, 10.0, 1012.0, -20.0), "2026-01-18T{}:40:00Z", ("09", "10", "11", "12", "13")),
)
CAMERAS = (  # detector, focal length, faintest magnitude that gives some thirty stars
    {"size_px": 1024, "focal_length_px": 4169.9, "faintest_mag": 6.2},
    {"size_px": 1024, "focal_length_px": 7322.0, "faintest_mag": 7.6},
    {"size_px": 1280, "focal_length_px": 2388.0, "faintest_mag": 5.2},
    {"size_px": 512, "focal_length_px": 1448.0, "faintest_mag": 5.6},
)
ALTITUDES_DEG = (35.0, 45.0, 60.0, 75.0, 89.5)
LENGTHS = ((60.0, 5.0), (300.0, 2.0), (600.0, 1.0), (1800.0, 0.5), (7200.0, 0.15))


def setting(rng: np.random.Generator, number: int) -> tuple[World, Plan]:
    """A world in which all is as stated, and a session under it."""
    site, start, hours = SITES[number % len(SITES)]
    seconds, rate_hz = LENGTHS[rng.integers(len(LENGTHS))]
    whole = bool(rng.random() < 0.5)
    world = World(
        site,
        azimuth_deg=round(float(rng.uniform(0, 360)), 2),
        altitude_deg=float(rng.choice(ALTITUDES_DEG)),
        roll_deg=round(float(rng.uniform(-180, 180)), 2),
        whole_pixels=whole,
        noise_px=0.2 if whole else float(rng.choice([0.1, 0.2])),
        at_s=seconds * float(rng.uniform(0.25, 0.75)),
        wave_period_s=max(seconds / float(rng.uniform(1.5, 10)), 60.0),
        vibration_hz=float(rng.uniform(2, 40)),
        **CAMERAS[rng.integers(len(CAMERAS))],
    )
    return world, Plan(start.format(rng.choice(hours)), seconds, rate_hz, int(rng.integers(1 << 30)))


def _vector(rng: np.random.Generator, roll: float = 8.0) -> np.ndarray:
    """100 arcsec in a random direction, roll stretched as stars tell it worse."""
    direction = rng.normal(0, 1, 3) * (1, 1, roll)
    return np.asarray(100 * direction / np.linalg.norm(direction / (1, 1, roll)))


def _turned(world: World, arcsec: np.ndarray) -> World:
    across, up, roll = (np.asarray(arcsec) / 3600).tolist()
    level = max(math.cos(math.radians(world.altitude_deg)), 0.02)
    angles = {"azimuth_deg": world.azimuth_deg + across / level, "altitude_deg": world.altitude_deg + up}
    return replace(world, **angles, roll_deg=world.roll_deg + roll)


@dataclass(frozen=True)
class Cause:
    """The cause that is to be named, words that its equals may have, the change of a world by a size, a great one.

    The great size is of a random generator and the length of the session in s.
    """

    cause: str
    words: tuple[str, ...]
    change: Callable[[World, object], World]
    great: Callable[[np.random.Generator, float], object]
    altitudes_deg: tuple[float, ...] = ALTITUDES_DEG


LOW_DEG = (35.0, 45.0, 60.0)
"""Where air shows."""


def _air(quantity: str, great: float) -> Cause:
    """Air other than stated."""
    return Cause(
        "refraction",
        ("refraction",),
        lambda w, more: w.at(**{quantity: getattr(w.site, quantity) + more}),
        lambda r, _: great,
        LOW_DEG,
    )


CAUSES = {
    "mount": Cause("mount", ("mount",), _turned, lambda r, _: _vector(r)),
    "clock offset": Cause("clock offset", ("clock offset",), lambda w, s: replace(w, clock_s=s), lambda r, _: 20.0),
    "clock drift": Cause(
        "clock drift",
        ("clock drift", "a host's clock that"),
        lambda w, ppm: replace(w, clock_ppm=ppm),
        lambda r, seconds: 1e7 / seconds,
    ),
    "clock step": Cause("clock step", ("clock step",), lambda w, s: replace(w, clock_step_s=s), lambda r, _: 20.0),
    "slip": Cause(
        "slip of the mount", ("slip",), lambda w, v: replace(w, slip_arcsec=tuple(v)), lambda r, _: 3 * _vector(r)
    ),
    "mount moves": Cause(
        "mount moves",
        ("mount moves", "a mount that turns"),
        lambda w, v: replace(w, moves_arcsec_per_h=tuple(v)),
        lambda r, seconds: 3 * _vector(r) * 3600 / seconds,
    ),
    "thermal swing": Cause(
        "thermal sinusoid",
        ("thermal",),
        lambda w, v: replace(w, wave_arcsec=tuple(v)),
        lambda r, _: r.normal(0, 100, 2),
    ),
    "latitude": Cause("site", ("latitude",), lambda w, d: w.at(latitude_deg=w.site.latitude_deg + d), lambda r, _: 0.1),
    "longitude": Cause(
        "clock offset", ("longitude",), lambda w, d: w.at(longitude_deg=w.site.longitude_deg + d), lambda r, _: 0.1
    ),
    "pressure": _air("pressure_hpa", -500.0),
    "temperature": _air("temperature_c", -50.0),
    "focal length": Cause(
        "focal length",
        ("focal length",),
        lambda w, share: replace(w, focal_length_px=w.focal_length_px * (1 + share)),
        lambda r, _: 3e-3,
    ),
    "principal point": Cause(
        "principal point",
        ("principal point",),
        lambda w, v: replace(w, principal_point_px=tuple(v)),
        lambda r, _: r.normal(0, 8, 2),
    ),
    "distortion": Cause("distortion", ("distortion",), lambda w, k1: replace(w, k1=k1), lambda r, _: 4e-3),
    "vibration": Cause("vibration", ("vibration",), lambda w, s: replace(w, vibration_arcsec=s), lambda r, _: 30.0),
}


_SMALLER = 3
"""Times that a great size is halved, with which too little is identified."""


def injected(name: str, world: World, plan: Plan, rng: np.random.Generator, sigmas: float) -> World:
    """The world with one cause at so many standard errors."""
    cause = CAUSES[name]
    if name == "vibration":  # three times what the noise of some 25 stars makes of a boresight
        noise_px = math.hypot(world.noise_px, math.sqrt(1 / 12) * world.whole_pixels)
        return cause.change(world, sigmas / 2 * noise_px * math.degrees(1 / world.focal_length_px) * 3600 / 5)
    size = cause.great(rng, plan.seconds)
    other = replace(plan, seed=int(rng.integers(1 << 30)))
    course = _CLOCK_COURSES.get(name)
    shown, modelled = None, None
    for _ in range(_SMALLER):
        shown = session(world, world if course else cause.change(world, size), other)
        modelled = session_model(shown, statistics(shown).counted)
        if modelled is not None:
            break
        size = np.multiply(size, 0.5)
    if modelled is None:
        raise RuntimeError(f"{name}: {len(shown.frames.columns)} frames of {world} give no model")
    model = modelled.model
    if course:
        model = _with_clock(model, course(world, model.series.time_s) * size)
    return cause.change(world, np.multiply(size, sigmas / _significance(model, cause.cause) * rng.choice([-1, 1])))


_CLOCK_COURSES: dict[str, Callable[[World, np.ndarray], np.ndarray]] = {
    "clock step": lambda world, time_s: (time_s >= world.at_s).astype(float),
    "clock drift": lambda world, time_s: 1e-6 * time_s,
}
"""How fast a clock is over time, per unit of the size: a great one is told by the link, and its frames are left out."""


def _with_clock(model: SessionModel, fast_s: np.ndarray) -> SessionModel:
    """The same errors under a clock that is so fast (M,)."""
    more = model.along(pole(model.site), EARTH_RATE_ARCSEC_PER_S * fast_s)
    series = replace(model.series, errors_arcsec=model.series.errors_arcsec + more)
    at = model.site, model.mount
    return SessionModel.from_series(
        series, model.field, *at, is_fitted=model.is_fitted, pixel_arcsec=model.pixel_arcsec
    )


def _significance(model: SessionModel, cause: str) -> float:
    """Standard errors of a cause, with nothing else fitted, whether or not another one explains the errors better."""
    observed = model.observed()
    base, none = fine_causes.fitted_to(observed, []), fine_causes.together(observed, [])
    searched = [*steps(model, observed, base, none), *sinusoids(model, observed, base, none)]
    rivals = [*constant_causes(model), *causes_of_field(model), *drifts(model), *searched]
    best = max((one for one in rivals if one.cause == cause), key=lambda one: fine_causes.score(observed, [one]))
    told = fine_causes.told(model, observed, [best], best, ())
    return math.sqrt(float(((told.coefficients / told.errors) ** 2).sum()))


def word_of(name: str, found: tuple[Finding, ...]) -> str:
    """first, equal, silent or wrong, by the first finding."""
    cause = CAUSES[name]
    if not found:
        return "silent"
    if found[0].cause == cause.cause:
        return "first"
    return "equal" if any(word in text for word in cause.words for text in found[0].equals) else "wrong"


KINDS = ("first", "equal", "silent", "wrong")


def fine_table(sessions: int, sigmas: float, names: list[str], seed: int) -> None:
    print(f"| cause at {sigmas:g} standard errors | sessions | {' | '.join(KINDS)} |\n|---|---|---|---|---|---|")
    total: Counter[str] = Counter()
    for name in names:
        counts: Counter[str] = Counter()
        for number in range(sessions):
            rng = np.random.default_rng([seed, number, list(CAUSES).index(name)])
            world, plan = setting(rng, number)
            world = replace(world, altitude_deg=float(rng.choice(CAUSES[name].altitudes_deg)))
            if name == "thermal swing" and plan.seconds < 1.5 * world.wave_period_s:
                plan = replace(plan, seconds=600.0, rate_hz=1.0)  # a minute holds no whole swing
            true = injected(name, world, plan, rng, sigmas)
            found = judge(session(world, true, plan)).findings
            word = word_of(name, found)
            counts[word] += 1
            if word not in ("first", "equal") or len(found) > 1:
                _tell(word, world, plan, found, true)
        total += counts
        _row(name, counts)
    _row("all", total)


@dataclass(frozen=True)
class Mistake:
    """What an operator gets wrong: words that the first finding or its equals must have, and the two worlds."""

    words: tuple[str, ...]
    stated: Callable[[World], World] = lambda world: world
    true: Callable[[World], World] = lambda world: world


def _clock(words: str, seconds: float) -> Mistake:
    return Mistake((words,), true=lambda w: replace(w, clock_s=seconds))


def _place(words: str, **changes: Callable[[Site], float]) -> Mistake:
    return Mistake((words,), lambda w: w.at(**{name: change(w.site) for name, change in changes.items()}))


def _mount(words: str, **changes: Callable[[World], float]) -> Mistake:
    return Mistake((words,), lambda w: replace(w, **{name: change(w) for name, change in changes.items()}))


HOUR_S, DAY_S = 3600.0, 86_400.0
MISTAKES = {
    "latitude sign": _place("latitude sign", latitude_deg=lambda s: -s.latitude_deg),
    "longitude sign": _place("longitude sign", longitude_deg=lambda s: -s.longitude_deg),
    "both signs": _place(
        "latitude and longitude signs", latitude_deg=lambda s: -s.latitude_deg, longitude_deg=lambda s: -s.longitude_deg
    ),
    "another site": _place(
        "site",
        latitude_deg=lambda s: s.latitude_deg - 1.3,
        longitude_deg=lambda s: (s.longitude_deg + 177.9) % 360 - 180,
    ),
    "azimuth from south": _mount("azimuth from south", azimuth_deg=lambda w: (w.azimuth_deg + 180) % 360),
    "azimuth off by 90 deg": _mount("azimuth off by 90 deg", azimuth_deg=lambda w: (w.azimuth_deg + 90) % 360),
    "azimuth counted westwards": _mount("azimuth counted westwards", azimuth_deg=lambda w: -w.azimuth_deg % 360),
    "azimuth off by 7.3 deg": _mount("mount", azimuth_deg=lambda w: (w.azimuth_deg + 7.3) % 360),
    "zenith distance": _mount("zenith distance for altitude", altitude_deg=lambda w: 90 - w.altitude_deg),
    "roll off by 90 deg": _mount("roll off by 90 deg", roll_deg=lambda w: w.roll_deg + 90),
    "roll off by 180 deg": _mount("roll off by 180 deg", roll_deg=lambda w: w.roll_deg + 180),
    "roll sign": _mount("roll sign", roll_deg=lambda w: -w.roll_deg),
    "summer time": _clock("local time", HOUR_S),
    "UTC-7": _clock("local time", -7 * HOUR_S),
    "UTC+5:45": _clock("local time", 5.75 * HOUR_S),
    "UTC+12": _clock("local time", 12 * HOUR_S),
    "date one day ahead": _clock("clock off by a day", DAY_S),
    "date one day behind": _clock("clock off by a day", -DAY_S),
    "GPS time": _clock("GPS time", 18.0),
    "TAI": _clock("TAI", 37.0),
    "leap second": _clock("leap second", -1.0),
    "latency of 0.4 s": _clock("latency", 0.4),
    "mirrored image": Mistake(("mirrored",), true=lambda w: replace(w, mirrored=True)),
    "focal length 3 % long": Mistake(("focal length",), lambda w: replace(w, focal_length_px=1.03 * w.focal_length_px)),
    "focal length 3 % short": Mistake(
        ("focal length",), lambda w: replace(w, focal_length_px=0.97 * w.focal_length_px)
    ),
    "principal point off by 10 px": Mistake(
        ("principal point",), lambda w: replace(w, principal_point_px=(10.0, -4.0))
    ),
    "distortion not modelled": Mistake(("distortion",), true=lambda w: replace(w, k1=-0.01)),
    "no refraction": _place("refraction", pressure_hpa=lambda s: 0.0),
    "hot pixels": Mistake(("hot pixels",), true=lambda w: replace(w, hot_pixels=6)),
    "vibration of 30 arcsec": Mistake(("vibration",), true=lambda w: replace(w, vibration_arcsec=30.0)),
    "mount moves by 600 arcsec/h": Mistake(
        ("mount moves",), true=lambda w: replace(w, moves_arcsec_per_h=(600.0, 200.0, 0.0))
    ),
    "clock drift of 2000 ppm": Mistake(("clock drift",), true=lambda w: replace(w, clock_ppm=2000.0)),
    "clock step of 1 s": Mistake(("clock step",), true=lambda w: replace(w, clock_step_s=1.0, at_s=200.0)),
    "slip of 60 arcsec": Mistake(("slip",), true=lambda w: replace(w, slip_arcsec=(40.0, 40.0, 0.0), at_s=200.0)),
    "longitude 1 deg off": _place(
        "longitude", longitude_deg=lambda s: s.longitude_deg + 1.0 - 2 * (s.longitude_deg > 0)
    ),
    "longitude 0.2 deg off": _place(
        "longitude", longitude_deg=lambda s: s.longitude_deg + 0.2 - 0.4 * (s.longitude_deg > 0)
    ),
    "latitude 0.18 deg off": _place("latitude", latitude_deg=lambda s: s.latitude_deg + 0.18),
    "latitude 0.35 deg off": _place("latitude", latitude_deg=lambda s: s.latitude_deg + 0.35),
    "altitude 0.28 deg off": _mount("mount", altitude_deg=lambda w: w.altitude_deg + 0.28),
    "altitude 0.32 deg off": _mount("mount", altitude_deg=lambda w: w.altitude_deg - 0.32),
    "clock 100 s fast": _clock("clock offset", 100.0),
    "date a year ahead": _clock("date off by a year", 365 * DAY_S),
    "date a year behind": _clock("date off by a year", -366 * DAY_S),
    "pixels counted from 1": Mistake(("pixel origin",), true=lambda w: replace(w, principal_point_px=(1.0, 1.0))),
    "pixels counted from the corner": Mistake(
        ("pixel origin",), true=lambda w: replace(w, principal_point_px=(0.5, 0.5))
    ),
    "columns 0.2 % wider": Mistake(("pixel pitch",), true=lambda w: replace(w, wider_columns=-2e-3)),
    "columns 0.1 % narrower": Mistake(("pixel pitch",), true=lambda w: replace(w, wider_columns=1e-3)),
    "swing of 20 arcsec": Mistake(
        ("thermal",), true=lambda w: replace(w, wave_arcsec=(20.0, 10.0), wave_period_s=170.0)
    ),
}
GROSS_MOUNTS = ((200.0, 40.0, -10.0), (75.0, 50.0, 100.0), (310.0, 65.0, 20.0), (130.0, 35.0, -35.0))


def gross_table(names: list[str], places: list[int], seconds: float) -> None:
    """Mistakes of a usual size in sessions of some minutes, at each site: the verdict and the first finding."""
    print("| mistake | latitude / deg | named | verdict | first finding |\n|---|---|---|---|---|")
    for name, place in itertools.product(names, places):
        mistake, (azimuth, altitude, roll) = MISTAKES[name], GROSS_MOUNTS[place]
        site, start, hours = SITES[place]
        world = World(site, azimuth, altitude, roll, whole_pixels=place % 2 == 0)
        shown = session(mistake.stated(world), mistake.true(world), Plan(start.format(hours[1]), seconds, 1.0, place))
        told = judge(shown)
        texts = [text for one in told.findings[:1] for text in (str(one), *one.equals)]
        named = any(word in text for word in mistake.words for text in texts)
        more = "".join(f"; {one.cause}" for one in told.findings[1:])
        first = (texts or ["nothing"])[0][:110]
        print(
            f"| {name} | {site.latitude_deg:g} | {'yes' if named else 'NO'} | {told.word} | {first}{more} |", flush=True
        )


def _row(name: str, counts: "Counter[str]") -> None:
    print(f"| {name} | {counts.total()} | {' | '.join(str(counts[kind]) for kind in KINDS)} |", flush=True)


def _tell(word: str, world: World, plan: Plan, found: tuple[Finding, ...], true: World | None = None) -> None:
    """What a table does not show, to stderr."""
    where = f"latitude {world.site.latitude_deg} azimuth {world.azimuth_deg} altitude {world.altitude_deg}"
    camera = f"{world.size_px} px / {world.focal_length_px} px {'whole' if world.whole_pixels else world.noise_px}"
    changed = "".join(
        f" {name}={getattr(true, name)}"
        for name in World.__dataclass_fields__
        if true and getattr(true, name) != getattr(world, name)
    )
    texts = "; ".join(str(finding)[:120] for finding in found)
    print(f"    {word}: {where} {camera} {plan}{changed}: {texts}", file=sys.stderr, flush=True)


def clean_table(sessions: int, seed: int, wander: bool) -> None:
    """Nights in which nothing is wrong; with ``wander`` the boresight has noise of 1 to 3 arcsec over 3 to 300 s."""
    with_finding = 0
    for number in range(sessions):
        rng = np.random.default_rng([seed, number, 99])
        world, plan = setting(rng, number)
        size = (float(rng.choice([1.0, 3.0])), float(rng.choice([3.0, 30.0, 300.0])))
        shown = session(world, replace(world, wander=size) if wander else world, plan)
        found = judge(shown).findings
        with_finding += bool(found)
        if found:
            _tell(f"clean {size if wander else ''}", world, plan, found)
    print(f"clean nights{' with wander' if wander else ''}: {with_finding} of {sessions} have a finding")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", choices=["fine", "clean", "gross"])
    parser.add_argument("--sessions", type=int, default=3, help="of each cause")
    parser.add_argument("--sigmas", type=float, default=6.0)
    parser.add_argument("--only", action="append", choices=[*CAUSES, *MISTAKES], help="can be given again")
    parser.add_argument("--places", type=int, nargs="+", default=[0, 1, 2, 3], help="of the sites, for gross")
    parser.add_argument("--seconds", type=float, default=300.0, help="of a session, for gross")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--wander", action="store_true", help="with correlated noise of the boresight")
    options = parser.parse_args()
    started = time.process_time()
    if options.table == "fine":
        fine_table(options.sessions, options.sigmas, options.only or list(CAUSES), options.seed)
    elif options.table == "gross":
        gross_table(options.only or list(MISTAKES), options.places, options.seconds)
    else:
        clean_table(options.sessions, options.seed, options.wander)
    print(f"{time.process_time() - started:.0f} s of processor time", file=sys.stderr)
