"""Availability, false answers and noise by condition, on nights whose sensor fails below a known angle to the Moon."""

import numpy as np
import pyarrow as pa
import pytest

from gse.campaign.conditions import BinOutcome, conditions
from gse.campaign.dataset import FRAMES, Committed, DataSet
from gse.campaign.decision import CampaignRow
from gse.campaign.nights import Session, with_answers
from gse.report.parquet import write_parquet
from gse.station.results import Subject
from gse.statistics.decision import Outcome
from gse.values.instant import from_text
from gse.verdict.requirements import AVAILABILITY, FALSE_ANSWERS

FULL_MOON = "2026-03-03T15:00:00Z"
THRESHOLD_DEG = 64.0
LIMITS = {AVAILABILITY.name: 0.95, FALSE_ANSWERS.name: 0.01}


def rows():
    nan = float("nan")
    return [
        CampaignRow("onboard", name, "", nan, nan, limit, Outcome.NOT_TESTED, "", 0, nan, nan, nan, "", 0, 0, 0)
        for name, limit in LIMITS.items()
    ]


def moonlit(rng, *, start=FULL_MOON, frames=2400, from_deg=100.0, to_deg=40.0, below=0.5, excused=0):
    """The frames of a night in which the Moon comes nearer; ``excused`` of those below the threshold show no star."""
    apart = np.linspace(from_deg, to_deg, frames)
    near = apart < THRESHOLD_DEG
    answered = rng.random(frames) < np.where(near, below, 0.995)
    blind = np.zeros(frames, dtype=bool)
    blind[np.flatnonzero(near)[:excused]] = True
    answered &= ~blind
    noise = np.where(near, 8.0, 3.0)
    return pa.table(
        {
            "utc": pa.array(from_text(start) + 5_000_000_000 * np.arange(frames)).cast(pa.timestamp("ns", "UTC")),
            "expected": ~blind,
            "sky_condition": np.where(blind, "no stars", "clear").tolist(),
            "stars_expected": np.full(frames, 20.0),
            "temperature_c": np.full(frames, 12.0),
            "sun_altitude_deg": np.full(frames, -40.0),
            "sun_separation_deg": np.full(frames, 120.0),
            "moon_altitude_deg": np.full(frames, 30.0),
            "moon_separation_deg": apart,
            "onboard_status": np.where(answered, "IDENTIFIED", "NO_MATCH").tolist(),
            "onboard_false": np.zeros(frames, dtype=bool),
            "onboard_used": answered,
            "onboard_d_ra_cosde_arcsec": 20 + rng.normal(0, noise),
            "onboard_d_de_arcsec": -7 + rng.normal(0, noise),
        }
    )


def found(folder, nights):
    dataset, sessions = DataSet.at(str(folder), create=True), []
    for day, frames in enumerate(nights, 1):
        row = {
            "sensor": "A", "night": f"2026-03-{day:02d}", "key": f"{day:064x}",
            "mount_altitude_deg": 80.0, "error": None,
            "onboard_available_of": len(frames), "onboard_available_n_eff": float(len(frames)),
        }  # fmt: skip
        parquet = folder / "part.parquet"
        write_parquet([frames], parquet)
        dataset.put(Committed("A", row["night"], row["key"]), FRAMES, parquet)
        sessions.append(Session(row, ""))
    return {one.name: one for one in conditions(dataset, sessions, Subject.ONBOARD, rows())}


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def test_the_angle_from_which_a_sensor_holds_is_found_with_its_interval(tmp_path, rng):
    moon = found(tmp_path, [moonlit(rng) for _ in range(4)])["angle to the Moon, half lit or more"]
    assert moon.holding.low_deg <= THRESHOLD_DEG <= moon.holding.high_deg
    assert moon.holding.high_deg - moon.holding.low_deg <= 10
    near, far = moon.bins[0], moon.bins[-2]
    assert (near.outcome, far.outcome, near.nights) == (BinOutcome.FAILS, BinOutcome.HOLDS, 4)
    assert (moon.bins[-1].outcome, moon.bins[-1].frames) == (BinOutcome.TOO_FEW, 4)  # those at 100 deg
    assert near.availability == pytest.approx(0.5, abs=0.05)
    assert far.availability == pytest.approx(0.995, abs=0.01)


def test_noise_is_that_of_one_axis_whatever_the_bias(tmp_path, rng):
    moon = found(tmp_path, [moonlit(rng) for _ in range(4)])["angle to the Moon, half lit or more"]
    assert moon.bins[0].noise_arcsec == pytest.approx(8.0, rel=0.15)
    assert moon.bins[-2].noise_arcsec == pytest.approx(3.0, rel=0.1)
    assert 0 < moon.bins[-2].noise_u_arcsec < 1


def test_the_interval_holds_the_true_angle_in_95_percent_of_campaigns(tmp_path, rng):
    held, narrow = 0, 0
    for number in range(40):
        folder = tmp_path / str(number)
        folder.mkdir()
        one = found(folder, [moonlit(rng, frames=900) for _ in range(3)])["angle to the Moon, half lit or more"].holding
        held += one.low_deg <= THRESHOLD_DEG <= one.high_deg
        narrow += one.high_deg - one.low_deg <= 10
    assert held >= 38
    assert narrow >= 32


def test_frames_that_show_no_star_near_the_moon_do_not_show_that_the_sensor_holds(tmp_path, rng):
    blinded = [moonlit(rng, below=0.995, excused=400) for _ in range(4)]
    moon = found(tmp_path, blinded)["angle to the Moon, half lit or more"]
    assert moon.bins[4].blind > 100  # 60 to 65 deg, where the excused frames begin
    assert moon.bins[4].outcome is BinOutcome.UNDECIDED
    assert moon.holding.high_deg >= THRESHOLD_DEG


def test_a_thin_moon_is_counted_apart(tmp_path, rng):
    by_name = found(tmp_path, [moonlit(rng), moonlit(rng, start="2026-03-22T15:00:00Z")])
    bright, thin = (by_name[f"angle to the Moon, {lit}"] for lit in ("half lit or more", "less than half lit"))
    assert bright.bins[0].nights == thin.bins[0].nights == 1


def test_a_condition_that_never_changed_is_left_out(tmp_path, rng):
    assert list(found(tmp_path, [moonlit(rng)])) == ["angle to the Moon, half lit or more"]


def test_a_session_without_any_compared_answer_tells_nothing_of_conditions():
    row = {"error": None, "onboard_d_de_n": 5, "sensor_d_de_n": None}
    counted, dark = Session(row, "too short"), Session(row | {"onboard_d_de_n": 0}, "no answer")
    copied, broken = Session(row, "damaged", copy=True), Session(row | {"error": "no station"}, "broken")
    assert with_answers([counted, dark, copied, broken]) == [counted]


@pytest.mark.parametrize(
    ("near", "far", "says"),
    [
        (0.995, 0.995, "holds from 40 deg on. No angle is shown at which it fails"),
        (0.5, 0.5, "fails at 60 deg; no angle is shown"),
        (0.5, 0.995, "between 60 and 65 deg (95 %)"),
    ],
)
def test_the_sentence_says_what_is_known(tmp_path, rng, near, far, says):
    to_deg, from_deg = (40.0, 100.0) if far > near or near > 0.9 else (40.0, 64.0)
    nights = [moonlit(rng, below=near, from_deg=from_deg, to_deg=to_deg) for _ in range(4)]
    assert says in found(tmp_path, nights)["angle to the Moon, half lit or more"].holding.text()
