"""A protocol of floats: NaN, infinity, -0 and denormals in each field, from the wire to the report."""

import json
from pathlib import Path

import numpy as np
import pytest
from devices.command_line import runner
from devices.float_protocol import DESCRIPTION, PROTOCOL, cases

from drivers.chunk import Chunk
from drivers.session_file.writer import CaptureWriter
from gse.config.station import BUILT_IN_TEXT
from gse.station.reception import Reception

START_NS = 1_774_018_800_000_000_000


@pytest.mark.parametrize(("field", "name", "data"), cases(), ids=lambda value: value if isinstance(value, str) else "")
def test_what_is_no_number_of_its_field_is_a_problem_and_nothing_else(field: str, name: str, data: bytes) -> None:
    reception = Reception(PROTOCOL, baudrate=115200)
    (panorama,) = reception.receive(reception.stream.feed(Chunk(START_NS, 10**9, data))).panoramas
    assert bool(panorama.problems) == (name not in ("-0", "denormal")), panorama.problems
    if panorama.problems:
        assert field in panorama.problems[0]
    else:
        assert np.isfinite([panorama.exposure_s, panorama.temperature_c]).all()
        assert np.isfinite(panorama.xy_px).all()
    assert 0 <= panorama.utc_ns < 2**63


def test_a_session_of_them_gives_json_without_nan_and_counts_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "session.mcap"
    protocol = tmp_path / "floats.yaml"
    protocol.write_text(DESCRIPTION)
    sent = cases()
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", f"{BUILT_IN_TEXT}protocol: {protocol}\n".encode())
        writer.attach("protocol.yaml", "application/yaml", DESCRIPTION.encode())
        for place, (_, _, data) in enumerate(sent):
            writer.rx(Chunk(START_NS + 10**8 * place, 10**8 * place, data))
    gse = runner(capsys)

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} in JSON")

    done = gse("replay", path, "--json-frames", "--json", "--out", tmp_path / "out")
    lines = [json.loads(line, parse_constant=refuse) for line in done.out.splitlines()]
    assert done.code in (1, 5)
    faults = [line for line in lines if line.get("status") == "SENSOR_FAULT"]
    assert len(faults) == sum(name not in ("-0", "denormal") for _, name, _ in sent)
    done = gse("decode", path, "--json")
    assert all(json.loads(line, parse_constant=refuse) for line in done.out.splitlines())
    assert done.code == 0
