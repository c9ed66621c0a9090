"""Whether an error says that the memory did not suffice; libraries say so in ways of their own."""

from __future__ import annotations

ADVICE = (
    "out of memory; give it more (`ulimit -v`, the container's limit), or take a part of the"
    " recording (`scenetrace cut`)"
)
_WORDS = (
    "can't start new thread",
    "Insufficient memory",
    "Out of Memory Error",
    "failed to map segment",
    "Cannot allocate memory",
    "std::bad_alloc",
)


def out_of_memory(error: BaseException) -> bool:
    """Whether an error, or one that it came from, is for want of memory.

    >>> out_of_memory(MemoryError()), out_of_memory(RuntimeError("can't start new thread"))
    (True, True)
    >>> out_of_memory(ValueError("no number"))
    False
    """
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, MemoryError) or any(word in str(seen) for word in _WORDS):
            return True
        seen = seen.__cause__ or seen.__context__
    return False
