"""The report of a session: report.json, report.html, frames.csv, junit.xml, and the verdict on the terminal."""

from gse.report.summary import summarise
from gse.report.writing import write_report

__all__ = ["summarise", "write_report"]
