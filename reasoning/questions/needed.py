"""Which tables a question reads: of a log no other is filled.

A table is read where its name stands in the SQL as a word, whatever the word means there; so at
worst one too many is filled. SQL that finds tables without naming them reads all of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from reasoning.questions.schema import SURE, TABLES

DIGEST = "recordings.digest"
"""The column that costs a reading of the whole file, as if it were a table."""
EVERYTHING = frozenset((*TABLES, DIGEST))
OF_DRAWING = frozenset({"frames", "tracks", "events", "zones", "recordings"})
"""What zones and lines that are drawn after the fact, and metres, are made from."""
_UNNAMED = re.compile(
    r'\bquery(_table)?\b|\b(duckdb|pragma|pg|sqlite)_|\b(information_schema|show)\b|\bu&"'
)
_OF_KIND = {
    "track": ("presence",), "zone": ("zones",), "place": ("zones",), "group": ("groups",), "event": ("events",)
}  # fmt: skip
_VIEWS = {"metres": "tracks"}


def tables_of(sql: str) -> frozenset[str]:
    """The tables of `schema.TABLES` that SQL may read, and `DIGEST` where it may read that."""
    text = sql.lower()
    if _UNNAMED.search(text):
        return EVERYTHING
    words = {word.removeprefix(SURE) for word in re.findall(r"\w+", text)}
    found = {_VIEWS.get(word, word) for word in words} & EVERYTHING
    if "recordings" in found and ("digest" in words or "*" in text):
        found.add(DIGEST)
    return frozenset(found)


def tables_ready(sql: str, kinds: Iterable[str] = ()) -> frozenset[str]:
    """As `tables_of`, of the SQL of a ready question or a pattern, with the tables that tell where
    there are gaps, and whether what it names is there; for the kinds of its words
    (`question.Question.kinds`).
    """
    named = (table for kind in kinds for table in _OF_KIND.get(kind, ()))
    return tables_of(sql) | {"frames", *named}


def tables_asked(sql: str) -> frozenset[str]:
    """As `tables_of`, of SQL that a person wrote: there are ways to all columns without a star."""
    found = tables_of(sql)
    return found | {DIGEST} if "recordings" in found else found
