import pytest
from devices.programs import program

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.inspection.preflight import check_external_identifier


@pytest.mark.parametrize(
    ("body", "outcome", "words"),
    [
        (
            "for line in sys.stdin: answer(json.loads(line), ra_deg=83.0, de_deg=0.01)",
            "OK",
            "finds the belt of Orion in",
        ),
        (
            "for line in sys.stdin: answer(json.loads(line), ra_deg=83 / 15, de_deg=0)",
            "WARN",
            "77.5 deg off in the belt",
        ),
        (
            "for line in sys.stdin: answer(json.loads(line), status='NO_MATCH')",
            "WARN",
            "no answer to the belt of Orion: NO",
        ),
        ("sys.exit(3)", "FAIL", "CRASH: it ended with exit code 3"),
    ],
    ids=["right", "hours for degrees", "no answer", "ends"],
)
def test_an_external_identifier_is_shown_the_belt_of_orion(tmp_path, body, outcome, words):
    path = program(tmp_path, body + "\n")
    text = f"{BUILT_IN_TEXT}identifier: {{algorithm: external, command: [{path}]}}\n"
    check = check_external_identifier(parse_station(text, "station.yaml"))
    assert (check.outcome, words in check.text) == (outcome, True)
    assert bool(check.advice) == (outcome != "OK")
