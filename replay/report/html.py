"""The report: one HTML file that opens offline in any browser; plotly draws, everything is
inside.
"""

from __future__ import annotations

import json
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from reasoning.questions import Case
from recorders.annotated.reader import AnnotatedLog
from replay.export.output import whole_file
from replay.report.data import ReportOptions, collect
from replay.report.pictures import check_log


def write_report(
    path: str | Path,
    out: str | Path,
    *,
    camera: str | None = None,
    options: ReportOptions | None = None,
    force: bool = False,
) -> dict[str, Any]:
    """Write the report of an annotated log; returns its key figures by name.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        RecordingError: the log is damaged, or no annotated log.
    """
    check_log(path)
    with AnnotatedLog(path, camera) as log, whole_file(out, force=force) as file:
        with Case([path]) as case:
            data = collect(case, log, options or ReportOptions())
        file.write(page(data).encode("utf-8"))
    return {str(name): value for name, value in data["figures"]}


def page(data: dict[str, Any]) -> str:
    """The HTML of collected data. Nothing of the data can end its script element: every `<` is
    written as an escape.
    """
    from plotly.offline import get_plotlyjs

    folder = files("replay.report")
    parts = {
        name: folder.joinpath(name).read_text(encoding="utf-8")
        for name in ("page.html", "page.css", "page.js")
    }
    embedded = json.dumps(
        data, ensure_ascii=True, allow_nan=False, separators=(",", ":")
    ).replace("<", "\\u003c")
    html = parts["page.html"]
    for mark, text in (
        ("{{title}}", escape(f"{data['recording']} - scenetrace report")),
        ("{{name}}", escape(str(data["recording"]))),
        ("{{style}}", parts["page.css"]),
        ("{{script}}", parts["page.js"]),
        ("{{plotly}}", get_plotlyjs()),
        ("{{data}}", embedded),
    ):
        before, found, after = html.partition(mark)
        assert found, mark
        html = before + text + after
    return html
