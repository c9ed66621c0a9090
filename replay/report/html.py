"""The report: one HTML file that opens offline in any browser; plotly draws, everything is
inside.
"""

from __future__ import annotations

import hashlib
import json
from base64 import b64encode
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from reasoning.questions import Case
from recorders.annotated.reader import AnnotatedLog
from recorders.limits import DEFAULT_LIMITS, Limits
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
    more: dict[str, Any] | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> dict[str, Any]:
    """Write the report of an annotated log; returns its key figures by name.

    Args:
        path: the log.
        out: the HTML file.
        camera: which camera, where there are several.
        options: how much goes into the page.
        force: overwrite.
        limits: bounds on what the log may make us allocate.
        more: what a case adds to the page's data.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        RecordingError: the log is damaged, or no annotated log.
    """
    check_log(path)
    with (
        AnnotatedLog(path, camera, limits) as log,
        whole_file(out, force=force) as file,
    ):
        with Case([path], log_limits=limits) as case:
            data = collect(case, log, options or ReportOptions()) | (more or {})
        file.write(page(data).encode("utf-8"))
    return {str(name): value for name, value in data["figures"]}


def page(data: dict[str, Any]) -> str:
    """The HTML of collected data. Nothing of the data can end its script element: every `<` is
    written as an escape; and no other script than the page's two can run.
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
    # A parser turns carriage returns into line feeds before it hashes.
    plotly = get_plotlyjs().replace("\r\n", "\n").replace("\r", "\n")
    html = parts["page.html"]
    for mark, text in (
        ("{{policy}}", policy([plotly, parts["page.js"]], bool(data["server"]))),
        ("{{title}}", escape(f"{data['recording']} - scenetrace report")),
        ("{{style}}", parts["page.css"]),
        ("{{name}}", escape(str(data["recording"]))),
        ("{{data}}", embedded),
        ("{{plotly}}", plotly),
        ("{{script}}", parts["page.js"]),
    ):
        before, found, after = html.partition(mark)
        assert found, mark
        html = before + text + after
    return html


def policy(scripts: list[str], served: bool) -> str:
    """The content security policy: these scripts alone, nothing from elsewhere; plotly needs
    inline styles.
    """
    hashes = " ".join(
        f"'sha256-{b64encode(hashlib.sha256(s.encode()).digest()).decode()}'"
        for s in scripts
    )
    own = " 'self'" if served else ""
    connect = " connect-src 'self';" if served else ""
    return (
        f"default-src 'none'; img-src{own} data: blob:; style-src 'unsafe-inline';"
        f" script-src {hashes};{connect} base-uri 'none'; form-action 'none'"
    )
