"""Times of a video's pictures where packets come in another order than pictures.

A message's time is its packet's. Where a video looks ahead (B pictures), the picture that is shown
first need not be the packet that came first: pictures get the times of the packets in the order in
which both increase. Stamps are the pictures' own where they tell the order of showing.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from recorders.log import Message
from recorders.pictures import Image

_MOST_BEHIND = 16
"""H.264 and H.265 allow so many packets before one whose picture precedes theirs."""


class Packet(NamedTuple):
    """A packet's message, with the picture's own stamp."""

    message: Message
    stamp_ns: int


class Given(NamedTuple):
    """A packet's time with a picture, None where there is none."""

    packet: Packet
    image: Image | None
    reason: str = ""


class PacketTimes:
    """Puts packets and pictures together again.

    Packets come by `put`, what became of them by `picture` or `lost`; `ready` gives what is known
    by then, in the order of the packets' times.
    """

    def __init__(self) -> None:
        self._packets: dict[int, Packet] = {}
        self._known: list[tuple[int, str | None]] = []
        self._pictures: deque[tuple[int, Image, int]] = deque()
        self._newest = -1
        self._latest_stamp = 0
        self._stamps_of_pictures = False

    def put(self, index: int, packet: Packet) -> None:
        """A packet."""
        self._packets[index] = packet
        if 0 < packet.stamp_ns < self._latest_stamp:
            self._stamps_of_pictures = True
        self._latest_stamp = max(self._latest_stamp, packet.stamp_ns)

    def picture(self, index: int, image: Image) -> None:
        """A picture, in the order of showing."""
        heapq.heappush(self._known, (index, None))
        self._pictures.append((index, image, self._packets[index].stamp_ns))
        self._newest = max(self._newest, index)

    def lost(self, index: int, reason: str) -> None:
        """A packet that gives no picture."""
        heapq.heappush(self._known, (index, reason))

    def ready(self, reorders: bool, ended: bool = False) -> Iterator[Given]:
        """What can be told by now; after the end, everything."""
        known = {index for index, _ in self._known}
        waiting = sorted(index for index in self._packets if index not in known)
        behind = _MOST_BEHIND if reorders and not ended else 0
        for index in waiting:
            if index < self._newest - behind or ended:
                self.lost(index, "")
        first = min((i for i in waiting if i >= self._newest - behind), default=None)
        while self._known and (ended or first is None or self._known[0][0] < first):
            index, reason = heapq.heappop(self._known)
            packet = self._packets.pop(index)
            if reason is not None:
                yield Given(packet, None, reason)
                continue
            _, image, stamp = self._pictures.popleft()
            if self._stamps_of_pictures:
                packet = packet._replace(stamp_ns=stamp)
            yield Given(packet, image)
