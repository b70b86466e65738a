"""Writes docs/notebook.ipynb: a session in a notebook, with what each cell shows; Jupyter is not needed for it.

python docs/make_notebook.py
"""

import ast
import base64
import contextlib
import io
import json
import os
import shutil
import sys
import tempfile
from code import InteractiveInterpreter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
CELLS = (
    "# A session in a notebook\n\nThe session is `replays/golden/clear.mcap`, copied to `clear.mcap`. "
    "More: [python.md](python.md).",
    'import gse\n\nverdict = gse.judge("clear.mcap")\nverdict',
    "print(repr(verdict))",
    'results = gse.load("clear.mcap")\nresults.errors.to_pandas().describe().round(2)',
    "results.plot()",
    'table = results.stars.to_pandas().query("frame == 0").sort_values("magnitude_mag")\n'
    "table = table.assign(brightness=range(len(table), 0, -1))\n"
    "answer = gse.identify(table)\n"
    'print(f"{answer.status.value}: RA {answer.attitude.ra_deg:.3f} deg, DE {answer.attitude.de_deg:.3f} deg")',
)


def cell(source: str, names: dict[str, Any]) -> dict[str, Any]:
    """A cell with what it prints and what its last line shows."""
    if source.startswith("#"):
        return {"cell_type": "markdown", "metadata": {}, "source": source}
    printed, outputs, shown = io.StringIO(), [], []
    *body, last = ast.parse(source).body
    run = InteractiveInterpreter(names).runcode
    before, sys.displayhook = sys.displayhook, shown.append
    try:
        with contextlib.redirect_stdout(printed):
            run(compile(ast.Module([*body], []), "cell", "exec"))
            run(compile(ast.Interactive([last]), "cell", "single"))
    finally:
        sys.displayhook = before
    value = shown[-1] if shown else None
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": printed.getvalue()})
    if value is not None:
        outputs.append(
            {"output_type": "execute_result", "execution_count": None, "metadata": {}, "data": shown_as(value)}
        )
    return {"cell_type": "code", "execution_count": None, "metadata": {}, "source": source, "outputs": outputs}


def shown_as(value: Any) -> dict[str, str]:
    """What Jupyter shows of a value."""
    if hasattr(value, "savefig"):
        picture = io.BytesIO()
        value.savefig(picture, format="png", dpi=80)
        return {"image/png": base64.b64encode(picture.getvalue()).decode(), "text/plain": "<Figure>"}
    html = value._repr_html_() if hasattr(value, "_repr_html_") else None
    return {"text/plain": repr(value)} | ({"text/html": html} if html else {})


def notebook() -> dict[str, Any]:
    """The whole notebook, run in a folder of its own."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(ROOT / "replays" / "golden" / "clear.mcap", folder)
        os.chdir(folder)
        try:
            names: dict[str, Any] = {}
            cells = [{"id": f"cell-{number}", **cell(source, names)} for number, source in enumerate(CELLS)]
        finally:
            os.chdir(here)
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return {"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}


if __name__ == "__main__":
    path = ROOT / "docs" / "notebook.ipynb"
    path.write_text(json.dumps(notebook(), indent=1) + "\n", encoding="utf-8")
