"""The files of a campaign's report: campaign.html and campaign.json in a new folder."""

import json
from pathlib import Path
from typing import Any

from gse.campaign.page import campaign_html
from gse.errors import UsageError


def write_campaign_report(report: dict[str, Any], folder: Path) -> Path:
    """Write the report into a new folder; the path of its page. campaign.json comes last: then the report is whole."""
    page = campaign_html(report)
    try:
        folder.mkdir(parents=True)
        (folder / "campaign.html").write_text(page, encoding="utf-8", newline="\n")
        text = json.dumps(report, indent=2, allow_nan=False) + "\n"
        (folder / "campaign.json").write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise UsageError(f"cannot write the report into {folder}: {error.strerror}; is the disk full?") from error
    return folder / "campaign.html"
