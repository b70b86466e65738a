"""The report of a session: report.json, report.html, frames.csv, junit.xml, and the verdict on the terminal.

Shows what ``assessment`` decided and decides nothing. May not import sessions or cli. What draws is in
``gse.report.session_plots``: code that needs the numbers alone does not wait for matplotlib.
"""

from gse.report.summary import summarise

__all__ = ["summarise"]
