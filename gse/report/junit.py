"""junit.xml: the measurements as test cases, for a CI server."""

import xml.etree.ElementTree as ET
from typing import Any


def junit_xml(report: dict[str, Any]) -> str:
    """One test case per measurement of a report; INCONCLUSIVE is skipped, with the reasons."""
    measurements = report["measurements"]
    outcomes = [measurement["outcome"] for measurement in measurements]
    suite = ET.Element(
        "testsuite",
        name=f"gse {report['session']['sensor']}",
        tests=str(len(outcomes)),
        failures=str(outcomes.count("FAIL")),
        errors="0",
        skipped=str(outcomes.count("INCONCLUSIVE")),
        timestamp=(report["session"]["first_utc"] or "")[:19],
    )
    for measurement in measurements:
        suite.append(_case(measurement, report["reasons"]))
    ET.indent(suite)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(suite, encoding="unicode") + "\n"


def _case(measurement: dict[str, Any], reasons: list[str]) -> ET.Element:
    case = ET.Element("testcase", classname="gse.measurements", name=measurement["name"])
    value = "unknown" if measurement["value"] is None else f"{measurement['value']:g}"
    text = f"{value} {measurement['unit']}".rstrip() + f", limit {measurement['limit']:g}"
    if measurement["outcome"] == "FAIL":
        ET.SubElement(case, "failure", message=text).text = "\n".join(reasons)
    elif measurement["outcome"] == "INCONCLUSIVE":
        ET.SubElement(case, "skipped", message="; ".join(reasons) or text)
    ET.SubElement(case, "system-out").text = text
    return case
