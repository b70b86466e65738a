"""junit.xml: the measurements as test cases, for a CI server."""

import xml.etree.ElementTree as ET
from typing import Any

from gse.report.terminal import is_simple, risk_text

_SESSION = "session"


def junit_xml(report: dict[str, Any]) -> str:
    """One test case per row of a report and one for the verdict.

    INCONCLUSIVE is an error of that type, a row that was not tested is skipped.
    """
    verdict = {
        "subject": _SESSION,
        "name": "verdict",
        "relative": report["relative"],
        "outcome": report["verdict"],
        "reason": "\n".join(report["reasons"]),
    }
    measurements = [*report["measurements"], verdict]
    outcomes = [measurement["outcome"] for measurement in measurements]
    suite = ET.Element(
        "testsuite",
        name=f"gse {report['session']['sensor']}" + (" SIMULATED" if report["simulated"] else ""),
        tests=str(len(outcomes)),
        failures=str(outcomes.count("FAIL")),
        errors=str(outcomes.count("INCONCLUSIVE")),
        skipped=str(outcomes.count("not tested")),
        timestamp=(report["session"]["first_utc"] or "")[:19],
    )
    for measurement in measurements:
        suite.append(_case(measurement, report))
    ET.indent(suite)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(suite, encoding="unicode") + "\n"


def _case(measurement: dict[str, Any], report: dict[str, Any]) -> ET.Element:
    case = ET.Element("testcase", classname=f"gse.{measurement['subject']}", name=measurement["name"])
    text = report["word"] if measurement["subject"] == _SESSION else _figures(measurement)
    if measurement["relative"]:
        text += "; relative to a mount fitted on the same sky: absolute pointing, site and clock not tested"
    if is_simple(report) and "false_pass_risk" in measurement:
        text += f"; decided by the value alone, risk of a false PASS {risk_text(measurement)}"
    if measurement["outcome"] == "FAIL":
        ET.SubElement(case, "failure", message=text).text = measurement["reason"]
    elif measurement["outcome"] == "INCONCLUSIVE":
        ET.SubElement(case, "error", type="INCONCLUSIVE", message=text).text = measurement["reason"]
    elif measurement["outcome"] == "not tested":
        ET.SubElement(case, "skipped", message=f"not tested: {measurement['reason']}")
    ET.SubElement(case, "system-out").text = text
    return case


def _figures(measurement: dict[str, Any]) -> str:
    value, uncertainty, limit = (_number(measurement[key]) for key in ("value", "uncertainty", "limit"))
    text = f"{value} {measurement['unit']}".rstrip() + f", U {uncertainty}, "
    return text + ("no limit stated" if measurement["limit"] is None else f"limit {limit}")


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:g}"
