"""The same as one PDF, to print and to hand over: text, tables and marked pictures, two in a row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fpdf import FPDF
from fpdf.enums import WrapMode, XPos, YPos

from replay.report.evidence_page import (
    Shown,
    caption_of,
    listed,
    made_rows,
    measured_rows,
    origin_rows,
    told_rows,
)

_NAME_MM, _MEASURE_MM, _LINE_MM, _GAP_MM = 45.0, 86.0, 4.6, 4.0
_LONGEST = 1500
_SMALL, _PLAIN, _LARGE, _TITLE = 8, 9.5, 12, 16
_NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)
"""A document's date is a clock's, and the same evidence shall be the same file."""


def write_pdf(
    out: Path, facts: Mapping[str, Any], shown: Sequence[Shown], folder: Path
) -> None:
    """Write the PDF of an evidence folder.

    Args:
        out: the file.
        facts: as facts.json has them.
        shown: what the folder shows.
        folder: where the pictures are.
    """
    pdf = _Document(str(facts["log_sha256"]))
    pdf.set_creation_date(_NO_DATE)
    pdf.set_title(_latin(f"Evidence from {facts['log']}"))
    pdf.set_auto_page_break(auto=True, margin=18)
    pdf.add_page()
    pdf.text_in(f"Evidence from {facts['log']}", _TITLE, bold=True)
    pdf.rows(origin_rows(facts))
    for one in shown:
        _section(pdf, one, folder)
    pdf.heading("What the log says of how it was made")
    pdf.rows([(k, str(v)[:_LONGEST]) for k, v in made_rows(facts)])
    pdf.output(str(out))


def _section(pdf: _Document, shown: Shown, folder: Path) -> None:
    e = shown.explanation
    pdf.heading(f"{e.reference}: {e.kind}")
    pdf.text_in(e.text, _PLAIN)
    pdf.rows(told_rows(e))
    if e.measures:
        pdf.text_in("Measured", _PLAIN, bold=True)
        pdf.rows(measured_rows(e), _MEASURE_MM)
    for title, lines in listed(e):
        pdf.text_in(title, _PLAIN, bold=True)
        for line in lines:
            pdf.text_in(f"- {line}", _SMALL)
    files = [name for name in (shown.clip, shown.plain, shown.piece) if name]
    pdf.text_in(f"In the folder: {', '.join(files)}", _SMALL)
    pdf.pictures([(folder / name, caption_of(name)[1]) for name in shown.pictures])


class _Document(FPDF):
    """A4, upright, with the log's digest and the page's number below."""

    def __init__(self, digest: str) -> None:
        super().__init__(format="A4")
        self._digest = digest
        self.set_margins(18, 16, 18)

    def footer(self) -> None:
        """The last line of every page."""
        self.set_y(-12)
        self.set_font("Helvetica", size=7)
        self.cell(0, 4, f"log SHA-256 {self._digest}   page {self.page_no()}", align="C")

    def text_in(self, text: str, size: float, *, bold: bool = False) -> None:
        """A paragraph."""
        self.set_font("Helvetica", "B" if bold else "", size)
        wrap = WrapMode.WORD if " " in text else WrapMode.CHAR
        self.multi_cell(
            0, size * 0.48, _latin(text), new_x=XPos.LMARGIN, new_y=YPos.NEXT, wrapmode=wrap
        )
        self.ln(0.8)

    def heading(self, text: str) -> None:
        """A line that has something below it on its page."""
        if self.will_page_break(45):
            self.add_page()
        self.ln(_GAP_MM)
        self.text_in(text, _LARGE, bold=True)

    def rows(self, rows: Sequence[tuple[str, Any]], name_mm: float = _NAME_MM) -> None:
        """Names to the left, values to the right, which break where they must."""
        for name, value in rows:
            if self.will_page_break(_LINE_MM):
                self.add_page()
            self.set_font("Helvetica", "B", _SMALL)
            self.cell(name_mm, _LINE_MM, self._fitting(str(name), name_mm - 2))
            self.set_font("Helvetica", "", _SMALL)
            self.multi_cell(
                0, _LINE_MM, _latin(str(value)), new_x=XPos.LMARGIN, new_y=YPos.NEXT,
                wrapmode=WrapMode.CHAR,
            )  # fmt: skip
        self.ln(1.5)

    def _fitting(self, text: str, width: float) -> str:
        plain = _latin(text)
        while plain and self.get_string_width(plain) > width:
            plain = plain[:-1]
        return plain

    def pictures(self, found: Sequence[tuple[Path, str]]) -> None:
        """Two in a row, each with what it is beneath."""
        width = (self.epw - _GAP_MM) / 2
        for k in range(0, len(found), 2):
            pair = [(path, said, *_size(path)) for path, said in found[k : k + 2]]
            tall = max(width * h / w for _, _, w, h in pair)
            if self.will_page_break(tall + 6):
                self.add_page()
            top = self.get_y()
            for n, (path, said, _, _) in enumerate(pair):
                left = self.l_margin + n * (width + _GAP_MM)
                self.image(str(path), x=left, y=top, w=width)
                self.set_xy(left, top + tall + 0.8)
                self.set_font("Helvetica", "", 7)
                self.cell(width, 3.5, _latin(said)[:80])
            self.set_xy(self.l_margin, top + tall + 6)


def _size(path: Path) -> tuple[int, int]:
    from recorders.pictures import read_header

    header = read_header(path.read_bytes(), path)
    return header.width, header.height


def _latin(text: str) -> str:
    """Letters that every PDF reader has; others as ``?``, and in full on the page."""
    return text.encode("latin-1", "replace").decode("latin-1")
