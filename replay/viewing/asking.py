"""A question of the page's, in a process of its own: `scenetrace query` with all its bounds."""

from __future__ import annotations

import csv
import subprocess
import sys
from itertools import islice
from pathlib import Path
from typing import Any

MOST_ROWS = 500
_SECONDS = 20
_MEMORY_MIB = 1024
_MOST_CHARACTERS = 2000
_RUN = "import scenetrace; raise SystemExit(scenetrace.main())"


def answer(path: Path, sql: str) -> dict[str, Any]:
    """The first rows of an answer as texts, or what was wrong."""
    words = [
        "query", str(path), sql, "--format", "csv", "--time-limit", str(_SECONDS),
        "--memory", str(_MEMORY_MIB),
    ]  # fmt: skip
    # -P: nothing is imported from the folder that happens to be the present one.
    with subprocess.Popen(
        [sys.executable, "-P", "-c", _RUN, *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
    ) as asked:
        assert asked.stdout is not None
        assert asked.stderr is not None
        rows = list(islice(csv.reader(asked.stdout), MOST_ROWS + 2))
        more = len(rows) > MOST_ROWS + 1
        if more:
            asked.kill()
        said = asked.stderr.read().strip()
        code = asked.wait()
    if code and not more:
        lines = said.splitlines() or ["the question was not answered"]
        return {"error": lines[-1].removeprefix("scenetrace: error: ")}
    cells = [[cell[:_MOST_CHARACTERS] for cell in row] for row in rows[1 : MOST_ROWS + 1]]
    return {"columns": rows[0] if rows else [], "rows": cells, "more": more}
