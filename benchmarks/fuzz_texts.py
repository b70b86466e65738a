"""Coverage-guided fuzzing of the readers of text files with atheris (pip install atheris).

    python benchmarks/fuzz_texts.py -max_total_time=900 CORPUS protocols gse/simulator/scenarios

Each input is read as a description of a protocol, whole and on top of a built-in one, as a station file, as a scenario
and as a panorama table. Anything but the error that each of them documents is a find. CORPUS is an empty folder that is
filled; the folders after it hold YAML files to begin with.
"""

import contextlib
import sys
import tempfile
from pathlib import Path

import atheris  # type: ignore[import-not-found]

with atheris.instrument_imports(include=["protocols", "gse"]):
    from gse.config.station import parse_station
    from gse.errors import ConfigError, TableError
    from gse.imaging.panorama_table import read_panorama_table
    from gse.simulator.scenario import parse_scenario
    from protocols import parse_protocol
    from protocols.errors import DescriptionError

TABLE = Path(tempfile.mkdtemp()) / "table.csv"


def one_input(data: bytes) -> None:
    """One input of the fuzzer."""
    TABLE.write_bytes(data)
    with contextlib.suppress(TableError):
        read_panorama_table(TABLE)
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return
    for start in ("", "extends: panorama-slip\n"):
        with contextlib.suppress(DescriptionError):
            parse_protocol(start + text, "fuzz.yaml")
    with contextlib.suppress(ConfigError):
        parse_station(text, "fuzz.yaml")
    with contextlib.suppress(ConfigError):
        parse_scenario(text, "fuzz.yaml")


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
