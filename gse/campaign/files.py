"""The files of a campaign's report: campaign.html and campaign.json in a new folder."""

import json
from pathlib import Path
from typing import Any

from drivers.whole_file import write_whole
from gse.campaign.page import campaign_html
from gse.errors import UsageError


def write_campaign_report(report: dict[str, Any], folder: Path) -> Path:
    """Write the report into a new folder; the path of its page. campaign.json comes last: then the report is whole."""
    page = campaign_html(report)
    try:
        folder.mkdir(parents=True)
        write_whole(folder / "campaign.html", [page])
        write_whole(folder / "campaign.json", [json.dumps(report, indent=2, allow_nan=False) + "\n"])
    except OSError as error:
        raise UsageError(f"cannot write the report into {folder}: {error.strerror}; is the disk full?") from error
    return folder / "campaign.html"
