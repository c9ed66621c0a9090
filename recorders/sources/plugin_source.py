"""Sources of somebody else's: ``NAME:WHERE``, NAME an entry point of ``scenetrace.sources`` or
``module:Class``.
"""

from __future__ import annotations

from pathlib import Path
from typing import cast

from recorders import plugins
from recorders.errors import SceneTraceError, SourceError, UsageError
from recorders.sources.source import Source

_NEEDED = (
    "path",
    "name",
    "width",
    "height",
    "frame_ns",
    "has_images",
    "stills",
    "has_detections",
    "frame_count",
    "notes",
    "losses",
    "frames",
    "sample",
    "digests",
)


def plugin_source(word: str | Path) -> Source | None:
    """The source that a word names, made with what stands behind the name; None where it names no
    plug-in.

    What is there as a file is that file, whatever a plug-in is called.

    Raises:
        UsageError: the plug-in is not there, or makes no `Source`.
        SourceError: it cannot open what it was given.
    """
    parts = str(word).split(":")
    if len(parts) < 2 or "/" in parts[0] or Path(word).exists():
        return None
    if parts[0] in plugins.names(plugins.SOURCES):
        name, where = parts[0], ":".join(parts[1:])
    elif len(parts) > 2 and all(
        part.isidentifier() for part in (*parts[0].split("."), parts[1])
    ):
        name, where = f"{parts[0]}:{parts[1]}", ":".join(parts[2:])
    else:
        return None
    made = plugins.load(plugins.SOURCES, name).value
    try:
        source = made(where)
    except SceneTraceError:
        raise
    except Exception as error:
        raise SourceError(
            f"the source {name} fails: {type(error).__name__}: {error}", where
        ) from error
    missing = [needed for needed in _NEEDED if not hasattr(source, needed)]
    if missing:
        raise UsageError(
            f"the source {name} lacks {' and '.join(missing)}: see scenetrace.Source"
        )
    return cast("Source", source)
