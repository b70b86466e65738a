"""CPU seconds of a report from kept results, by frames: reading them, judging, drawing, writing.

    python benchmarks/report.py 20000 288000

The frames are a made night of 2,000, repeated with new noise. A line per length is a process of its own; its first
column is what Python takes to import the packages.
"""

import itertools
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
_NIGHT = 2000
_STEP_NS = 100_000_000


def main() -> None:
    """A table for people."""
    if len(sys.argv) == 3 and sys.argv[1] == "one":
        one(int(sys.argv[2]))
        return
    print("| frames | imports | read | judge | report | all, CPU s |\n|---|---|---|---|---|---|")
    for frames in sys.argv[1:] or ("20000", "288000"):
        subprocess.run([sys.executable, __file__, "one", frames], check=True)


def one(count: int) -> None:
    """Keep the results of ``count`` frames, then make the report from them."""
    started = time.process_time()
    from gse.process.release_memory import spare_pandas
    from gse.report.files import write_report
    from gse.report.provenance import ResultKey
    from gse.sessions.kept_results import keep, kept
    from gse.verdict.assessment import judge

    imports = time.process_time() - started
    sys.path.insert(0, str(ROOT / "tests"))  # after gse: tests has a folder of that name
    spare_pandas()
    session, key = made(count), ResultKey("a" * 64, "b" * 64, "c" * 64)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        keep(session, judge(session), key, folder / "results")
        marks = [time.process_time()]
        found = kept(key, folder / "results", session.station, session.station_text)
        assert found is not None
        marks.append(time.process_time())
        assessment = judge(found)
        marks.append(time.process_time())
        write_report(found, assessment, folder)
        marks.append(time.process_time())
    parts = [imports, *(b - a for a, b in itertools.pairwise(marks))]
    print(f"| {count:,} | " + " | ".join(f"{part:.2f}" for part in (*parts, sum(parts))) + " |")


def made(count: int):  # type: ignore[no-untyped-def]
    """A session of ``count`` frames at 10 Hz, with as many matches as a session keeps."""
    import numpy as np
    from skies.synthetic_night import small_catalog, synthetic_night

    from gse.station.session_tables import MOST_MATCHES, FrameTable

    session = synthetic_night(_NIGHT)
    session.stars = small_catalog().listed
    frames, matches = np.tile(session.frames.columns.rows(), count // _NIGHT), session.frames.matches
    place = np.arange(len(frames))
    frames["utc_ns"] = frames["utc_ns"][0] + place * _STEP_NS
    frames["host_utc_ns"], frames["time_us"], frames["frame_no"] = frames["utc_ns"], place * _STEP_NS // 1000, place
    frames["d_de_arcsec"] += np.random.default_rng(1).normal(0, 1, len(frames))
    stride = -(-len(matches) * (count // _NIGHT) // MOST_MATCHES)
    parts = [matches[matches["frame"] % stride == 0].copy() for _ in range(count // _NIGHT)]
    for number, part in enumerate(parts):
        part["frame"] += _NIGHT * number
    session.frames = FrameTable.from_rows(frames, np.concatenate(parts))
    return session


if __name__ == "__main__":
    main()
