"""The files of a case."""

from __future__ import annotations

import os
from pathlib import Path

from recorders.files import sha256


def digests(case: Path, *, statuses: bool = True) -> dict[str, str]:
    """Every file of a case and its SHA-256, without what is not whole yet."""
    found = {}
    for folder, below, names in os.walk(case):
        below[:] = sorted(set(below) - ({".parts"} if statuses else {".parts", "status"}))
        for name in sorted(set(names) - {".lock"}):
            path = Path(folder) / name
            found[path.relative_to(case).as_posix()] = sha256(path)
    return found
