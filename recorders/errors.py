"""The errors that scenetrace raises: one base class, each message with what, where and what to
do.
"""

from __future__ import annotations

from pathlib import Path


class SceneTraceError(Exception):
    """Base of every error that scenetrace raises on purpose; its text is one line for a person."""


class UsageError(SceneTraceError):
    """The call's words are off (exit code 2).

    Attributes:
        headline: what is wrong, in one line.
        below: lines that stand below it, each as it is (a word of the call, a mark under a place
            in it).
    """

    def __init__(self, headline: str, *below: str) -> None:
        super().__init__("\n".join((headline, *below)))
        self.headline = headline
        self.below = below


class AmbiguousError(UsageError):
    """A file that may be read in two ways, of which the call has to name one.

    Attributes:
        why: what may be two things.
    """

    def __init__(self, path: object, why: str, choice: str) -> None:
        super().__init__(f"{path}: {why}; {choice}")
        self.why = why


class ConfigError(UsageError):
    """A parameter is unknown or out of its range; the text names the field, the value and the
    range.
    """


class OutputExistsError(SceneTraceError):
    """An output exists already and ``--force`` was not given."""

    def __init__(self, path: str | Path) -> None:
        super().__init__(
            f"{path} exists already, not overwriting it; give another name or --force"
        )
        self.path = Path(path)


class SourceError(SceneTraceError):
    """A source of frames or detections cannot be read: which file, where in it, why."""

    def __init__(self, reason: str, path: str | Path, line: int | None = None) -> None:
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {reason}")
        self.reason = reason
        self.path = Path(path)
        self.line = line


class RecordingError(SceneTraceError):
    """A log cannot be read or written as MCAP.

    Attributes:
        path: the file.
        offset: byte offset in the file where the trouble starts, if known.
        record: the MCAP record (``Chunk``, ``Message`` ...) or the channel's topic, if known.
        reason: what is wrong, and what to do where something can be done.
    """

    def __init__(
        self,
        reason: str,
        path: str | Path,
        offset: int | None = None,
        record: str | None = None,
    ) -> None:
        where = f"{path}"
        if offset is not None:
            where += f" at byte {offset}"
        if record is not None:
            where += f" ({record})"
        super().__init__(f"{where}: {reason}")
        self.reason = reason
        self.path = Path(path)
        self.offset = offset
        self.record = record


class LimitError(RecordingError):
    """A recording asks for more than a limit of `recorders.limits.Limits` allows; states value
    and limit.
    """
