"""Versions of installed packages, without what the library loads to tell them (a mail parser, sockets):
that takes a tenth of a short replay.
"""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

ABSENT = "absent"
_SUFFIX = ".dist-info"


@cache
def version_of(package: str) -> str:
    """The version of a package, as `importlib.metadata.version` gives it; `ABSENT` where there is
    none.
    """
    found = _folders().get(_plain(package))
    with suppress(OSError):
        if found is not None:
            with (found / "METADATA").open(encoding="utf-8", errors="replace") as lines:
                for line in lines:
                    if line.startswith("Version:"):
                        return line.removeprefix("Version:").strip()
                    if not line.strip():  # the end of the header
                        break
    # Installed in some other way: in an archive, or by an old tool.
    from importlib import metadata

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ABSENT


@cache
def _folders() -> dict[str, Path]:
    """What is installed in folders, by plain name; of several the first on the path."""
    found: dict[str, Path] = {}
    for folder in sys.path:
        paths: list[Path] = []
        with suppress(OSError):
            paths = sorted(Path(folder or ".").iterdir())
        for path in paths:
            if path.name.endswith(_SUFFIX):
                found.setdefault(_plain(path.name.partition("-")[0]), path)
    return found


def _plain(name: str) -> str:
    """A package's name, however it is written.

    >>> _plain("Foxglove.Schemas_protobuf")
    'foxglove-schemas-protobuf'
    """
    return re.sub(r"[-_.]+", "-", name).lower()
