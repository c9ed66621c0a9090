"""Reading ahead: frames are read and their pictures decoded in a thread of their own, a bounded
number in advance.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import suppress
from queue import Full, Queue
from threading import Event, Thread

from recorders.sources.source import PictureError, SourceFrame

_WAIT_S = 0.1


def read_ahead(
    frames: Iterator[SourceFrame], depth: int, decode: bool
) -> Generator[SourceFrame]:
    """The same frames in the same order; errors come where they would have come.

    Args:
        frames: the frames.
        depth: at most so many wait to be taken.
        decode: decode the pictures too.
    """
    queue: Queue[SourceFrame | BaseException | None] = Queue(depth)
    stop = Event()

    def put(item: SourceFrame | BaseException | None) -> None:
        while not stop.is_set():
            try:
                queue.put(item, timeout=_WAIT_S)
            except Full:
                continue
            return

    def work() -> None:
        try:
            for frame in frames:
                if decode:
                    # A bad picture shows where the frame is taken.
                    with suppress(PictureError):
                        _ = frame.image
                put(frame)
                if stop.is_set():
                    return
        except BaseException as error:
            put(error)
        else:
            put(None)

    thread = Thread(target=work, name="scenetrace-read-ahead", daemon=True)
    thread.start()
    try:
        while True:
            item = queue.get()
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            yield item
    finally:
        stop.set()
        thread.join()
