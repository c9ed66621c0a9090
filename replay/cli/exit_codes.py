"""The exit codes of every command, and what the help says of them."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """How a command ended. An interrupted one has failed."""

    DONE = 0
    FAILED = 1
    WRONG_USAGE = 2
    LEFT_OUT = 3
    DIFFERS = 4


_MEANING = {
    Exit.DONE: "done",
    Exit.FAILED: "failed",
    Exit.WRONG_USAGE: "wrong usage",
    Exit.LEFT_OUT: "done, but something was lost or left out",
    Exit.DIFFERS: "differs",
}
TEXT = "exit codes: " + "; ".join(
    f"{int(code)} {words}" for code, words in _MEANING.items()
)
