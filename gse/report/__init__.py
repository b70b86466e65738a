"""The report of a session: report.json, report.html, frames.csv, junit.xml, and the verdict on the terminal.

Shows what ``assessment`` decided and decides nothing. May not import sessions or cli.
"""

from gse.report.files import write_report
from gse.report.summary import summarise

__all__ = ["summarise", "write_report"]
