"""From shells and blobs to each object's place: who is alone, who shares, and pixels only where
they are shared.

An object that lies alone over a blob of its own size is measured by the blob. Objects that are
related (SHELLS 2.3, resolved on the predicted shells and blobs before anything is looked at) and
lie over common blobs form a neighbourhood: if each of them fits a blob of its own, blobs are
handed out whole; else every foreground pixel in their shells is evaluated (`membership`), without
any joint object (straight-through). Who is not related to an object, directly or through others,
is no rival of its (equation 7) and is evaluated without it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Box, Ellipse
from recorders.segmentation.blobs import ellipse_of
from replay.trackers.association import assign, clusters, iou
from replay.trackers.shells.colours import Bins, bins_of, distance, histogram, tell
from replay.trackers.shells.depth import Depth
from replay.trackers.shells.foreground import Cut, Foreground, touches
from replay.trackers.shells.membership import Claimants, Members, assign_pixels, extent
from replay.trackers.shells.objects import Bodies, Body
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.shells.placing import place
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.intp]

_LINK = 0.08
"""An object lies over a blob that fills this share of its box, or half of which lies in its box."""
_MINOR = 0.3
"""A blob of less than this share of an object's area need not be anybody's own."""
_SLACK = 0.25
"""A blob that is larger or smaller than an object by this share at most may be that one alone."""


@dataclass(slots=True)
class Resolved:
    """An object's observation in this frame.

    Attributes:
        box: measured box, pixels.
        place: E[P], brought from the pixels' mean to the box's centre.
        weight: share of a (equation 9) that these pixels deserve.
        sized: width and height were measured.
        alone: it has the blob for itself.
        blob: the blob's label.
        visible: share of its area that is its own.
        pixels: number of its own pixels.
        ellipse: of its own pixels.
        own, left, top: its own pixels and where they lie in the picture.
        misfit: nobody else lies over its blob, which still is not of its size.
    """

    box: Box
    place: tuple[float, float]
    weight: float
    sized: bool
    alone: bool
    blob: int
    visible: float
    pixels: int
    ellipse: Ellipse | None
    own: Bools
    left: int
    top: int
    misfit: bool = False


@dataclass(frozen=True, slots=True)
class SeenFrame:
    """What the resolution sees of a frame: its foreground, and its picture when it is asked for;
    ``unsized``: nothing is known of how large bodies are.
    """

    foreground: Foreground
    detection_boxes: Floats
    detection_blobs: NDArray[np.int64]
    image: Callable[[], Image | None]
    unsized: bool = True


class Resolver:
    """Finds the given rows of the bodies in a frame.

    Attributes:
        foreground: of the frame.
        found: by row.
        fronts: for rows that are hidden the id of who hides them.
        leads: evidence that the first of two ids lies in front of the second (`Depth.lead`).
        behind: rows that lie over a blob which is as large as somebody else alone.
        free: (M,) the blobs (rows) that no object lies over.
    """

    def __init__(
        self,
        frame: SeenFrame,
        bodies: Bodies,
        rows: Rows,
        radii: Floats,
        related: Callable[[int, int], bool],
        p: ShellsParameters,
    ) -> None:
        self.foreground = self._fg = frame.foreground
        self._frame = frame
        self._bodies = bodies
        self._radii = radii
        self._related = related
        self._p = p
        self._boxes = bodies.boxes
        self.found: dict[int, Resolved] = {}
        self.fronts: dict[int, int] = {}
        self.behind: set[int] = set()
        self.leads: dict[tuple[int, int], float] = {}
        self.free: Bools = np.ones(len(self._fg.boxes), bool)
        self._rows = rows
        boxes = self._boxes[rows]
        area = np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)
        self._pixels = self._fg.links(boxes)
        self._linked = np.asarray(
            (self._pixels > 0)
            & (
                (self._pixels >= _LINK * area[:, None])
                | (self._pixels >= 0.5 * self._fg.areas)
            )
        )

    def blobs(self) -> dict[int, int]:
        """The blob (label) that each object lies over by its prediction, by row: B_i of the
        events' cases.
        """
        held = np.where(self._linked, self._pixels, 0.0)
        return {
            int(row): int(np.argmax(held[index])) + 1
            for index, row in enumerate(self._rows)
            if self._linked[index].any()
        }

    def resolve(self) -> None:
        """Find the objects: `found` and `fronts`. Relations are asked for here, not before."""
        if not len(self._rows) or not len(self._fg.boxes):
            return
        rows, fg, pixels, linked = self._rows, self._fg, self._pixels, self._linked
        self.free = np.asarray(~linked.any(axis=0))
        sized = self._fits(rows)
        patient = [self._bodies.items[row].misfit_s > self._p.patience_s for row in rows]
        fits = sized | np.array(patient, bool)[:, None]
        tenants = linked.sum(axis=0)
        held = np.bincount(
            np.clip(self._frame.detection_blobs, 0, len(fg.boxes)),
            minlength=len(fg.boxes) + 1,
        )[1:]
        shared: list[int] = []
        for i in range(len(rows)):
            mine = np.flatnonzero(linked[i])
            if not len(mine):
                continue
            main = int(mine[np.argmax(pixels[i, mine])])
            if tenants[main] == 1 and held[main] <= 1 and fits[i, main]:
                at = self.found[int(rows[i])] = self.whole(int(rows[i]), main)
                at.misfit = self._frame.unsized and not sized[i, main]
            else:
                shared.append(i)
        hidden = self._hidden(rows, linked, shared)
        for members in self._neighbourhoods(shared):
            blobs = np.flatnonzero(linked[members].any(axis=0))
            sought = [
                row
                for row in hidden
                if any(self._reappears(rows, row, member) for member in members)
            ]
            hidden = [row for row in hidden if row not in sought]
            everyone = sorted(members + sought)
            self._neighbourhood(rows[everyone], blobs, fits[everyone])

    def _neighbourhoods(self, shared: list[int]) -> list[list[int]]:
        """Objects over common blobs that are related, directly or through others."""
        together = []
        for members in clusters(shared, self._linked):
            ids = [self._bodies.items[int(self._rows[member])].id for member in members]
            pairs = np.array(
                [
                    [identity == other or self._related(identity, other) for other in ids]
                    for identity in ids
                ]
            )
            together += [
                [members[row] for row in part]
                for part in clusters(list(range(len(ids))), pairs)
            ]
        return sorted(together)

    def _hidden(self, rows: Rows, linked: Bools, shared: list[int]) -> list[int]:
        """Objects that lie over no blob and were hidden by another when last sought, or meet
        another now.
        """
        items = self._bodies.items
        gone = [
            row
            for row in range(len(rows))
            if int(rows[row]) not in self.found and row not in shared
        ]
        return [row for row in gone if not linked[row].any() or items[rows[row]].front]

    def _reappears(self, rows: Rows, hidden: int, other: int) -> bool:
        """Whether a hidden object may reappear around another: one that it is related to (SHELLS
        2.3, case III).
        """
        a, b = (self._bodies.items[int(rows[row])] for row in (hidden, other))
        return a.front == b.id or self._related(a.id, b.id)

    def _fits(self, rows: Rows) -> Bools:
        """Whether each blob is of each object's area, (N, M); what the border cuts may be smaller."""
        p, fg = self._p, self._fg
        items = [self._bodies.items[row] for row in rows]
        area = np.array([item.area for item in items])
        ratio = fg.areas[None, :] / np.maximum(area, 1.0)[:, None]
        height, width = fg.mask.shape
        cut = touches(fg.boxes, width, height)
        mine = touches(self._boxes[rows], width, height)
        low = (ratio >= p.smaller) | cut[None, :]
        high = (ratio <= p.larger) | (
            cut[None, :] & mine[:, None] & (ratio <= 2 * p.larger)
        )
        return np.asarray(low & high)

    def whole(self, row: int, blob: int) -> Resolved:
        """A blob that belongs to an object as it is."""
        b = self._fg.components[blob]
        x, y, w, h = (int(value) for value in b.box)
        others = self._fg.boxes
        meets = (others[:, 0] < x + w) & (others[:, 0] + others[:, 2] > x)
        meets &= (others[:, 1] < y + h) & (others[:, 1] + others[:, 3] > y)
        alone_in_box = int(np.count_nonzero(meets)) == 1
        own = (
            self._fg.mask[y : y + h, x : x + w] > 0
            if alone_in_box
            else self._fg.pixels(blob)
        )
        body = self._bodies.items[row]
        visible = min(1.0, b.area / max(1.0, body.area))
        place = body.place_of((b.ellipse.x, b.ellipse.y), b.box)
        return Resolved(
            box=b.box,
            place=place,
            weight=1.0,
            sized=True,
            alone=True,
            blob=blob + 1,
            visible=visible,
            pixels=b.area,
            ellipse=b.ellipse,
            own=own,
            left=x,
            top=y,
        )

    def _neighbourhood(self, rows: Rows, blobs: Rows, fits: Bools) -> None:
        """Objects over common blobs: blobs whole if everybody has one, else pixel by pixel."""
        seen = self._only_one(rows, blobs)
        if seen is not None:
            k, blob = seen
            ids = [self._bodies.items[int(row)].id for row in rows]
            left = np.ones(len(rows), bool)
            for j, row in enumerate(rows.tolist()):
                if j != k:
                    self.behind.add(row)
                    left[j] = self._bodies.items[row].twin_s <= self._p.twin_s
                    if not left[j]:
                        self.fronts[row] = ids[k]
            if left.sum() == 1:
                self.found[int(rows[k])] = self.whole(int(rows[k]), blob)
                return
            rows, fits = rows[left], fits[left]
        handed = self._hand_out(rows, blobs, fits[:, blobs])
        if handed is not None:
            for k, m in handed:
                self.found[int(rows[k])] = self.whole(int(rows[k]), int(blobs[m]))
            return
        self._evaluate(rows, blobs, fits)

    def _only_one(self, rows: Rows, blobs: Rows) -> tuple[int, int] | None:
        """Whose body (index into the rows) a blob is that several lie over, though it is as large
        as one of them alone: whose colours it has; and the blob. None where it holds more.
        """
        if len(rows) < 2:
            return None
        fg, items = self._fg, [self._bodies.items[row] for row in rows]
        blob = int(blobs[np.argmax(fg.areas[blobs])])
        box, area = fg.boxes[blob], float(fg.areas[blob])
        if float(fg.areas[blobs].sum()) > (1 + _SLACK) * area:
            return None
        fits = [
            (1 - _SLACK) * item.area <= area <= (1 + _SLACK) * item.area
            and bool((box[2:] <= (1 + _SLACK) * self._boxes[row, 2:]).all())
            for item, row in zip(items, rows.tolist(), strict=True)
        ]
        if not any(fits):
            return None
        away = self._colour_cost(items, np.array([blob], np.intp))[:, 0].tolist()
        centre = box[:2] + box[2:] / 2
        off = np.abs(self._bodies.bank.value[rows, :2] - centre).sum(axis=1).tolist()
        # Who has been held to be hidden stays so: two who are alike would take turns.
        held = [item.twin_s > self._p.twin_s for item in items]
        k = min(
            (k for k in range(len(rows)) if fits[k]),
            key=lambda k: (held[k], away[k], off[k], k),
        )
        return k, blob

    def _hand_out(
        self, rows: Rows, blobs: Rows, fits: Bools
    ) -> list[tuple[int, int]] | None:
        """A blob of its own for each of several objects, and no large blob left; None where that
        cannot be.
        """
        fg = self._fg
        items = [self._bodies.items[row] for row in rows]
        major = fg.areas[blobs] >= _MINOR * min(item.area for item in items)
        if int(np.count_nonzero(major)) != len(rows):
            return None
        blob_boxes = fg.boxes[blobs]
        centre = self._bodies.bank.value[rows, :2]
        away = centre[:, None] - (blob_boxes[:, :2] + blob_boxes[:, 2:] / 2)[None]
        gap = (
            np.sqrt(away[..., 0] * away[..., 0] + away[..., 1] * away[..., 1])
            / self._radii[rows][:, None]
        )
        allowed = fits & major[None, :] & (gap <= 1.5)
        cost = gap + 1.0 - iou(self._boxes[rows], blob_boxes)
        if len(rows) > 1:
            cost = cost + self._colour_cost(items, blobs)
        pairs = assign(cost, allowed)
        return pairs if len(pairs) == len(rows) else None

    def _colour_cost(self, items: Sequence[Body], blobs: Rows) -> Floats:
        """Hellinger distances of objects' colours and blobs', (N, M); 0.4 where colours are not
        known.
        """
        out = np.full((len(items), len(blobs)), 0.4)
        image = self._frame.image()
        if image is None or all(item.colours is None for item in items):
            return out
        for index, blob in enumerate(blobs.tolist()):
            x, y, w, h = (int(value) for value in self._fg.components[blob].box)
            seen = histogram(bins_of(image[y : y + h, x : x + w]), self._fg.pixels(blob))
            for k, body in enumerate(items):
                if body.colours is not None:
                    out[k, index] = distance(body.colours, seen)
        return out

    def _evaluate(self, rows: Rows, blobs: Rows, fits: Bools) -> None:
        """Pixel by pixel (SHELLS 2.4)."""
        items = [self._bodies.items[row] for row in rows]
        boxes, radii = self._boxes[rows], self._radii[rows]
        blobs = self._with_fragments(boxes, radii, blobs)
        size = np.sqrt(boxes[:, 2] * boxes[:, 3])
        x1, y1 = (int(value) for value in (boxes[:, :2] - size[:, None]).min(axis=0))
        x2, y2 = (
            int(value) + 1
            for value in (boxes[:, :2] + boxes[:, 2:] + size[:, None]).max(axis=0)
        )
        cut = self._fg.cut(blobs.tolist(), x1, y1, x2, y2)
        self._frame.image()
        tells = tell([item.colours for item in items])
        bins = self._bins(cut) if any(t is not None for t in tells) else None
        who = Claimants(boxes, radii, tells, [item.mask for item in items])
        reach = np.sqrt(self._bodies.bank.p00[rows, :2]).max(axis=1)
        for index, body in enumerate(items):
            if body.front:
                reach[index] = max(float(reach[index]), 0.5 * float(radii.max()))
        order = np.argsort([-item.visible for item in items], kind="stable").tolist()
        if self._p.placing:
            who = Claimants(
                place(who, reach, order, cut, bins, self._p), radii, tells, who.masks
            )
        members = assign_pixels(who, cut, bins, self._p)
        owner = members.owner
        whole = self._lone(owner, rows, blobs, fits, cut)
        self._deny_strangers(items, owner, bins, whole)
        self._measure(rows, who, owner, members, cut, whole)
        self._agree(rows, blobs)

    def _with_fragments(self, boxes: Floats, radii: Floats, blobs: Rows) -> Rows:
        """The blobs, and those that nobody lies over but that lie within a shell."""
        fg = self._fg
        centre = boxes[:, :2] + boxes[:, 2:] / 2
        away = centre[:, None] - (fg.boxes[:, :2] + fg.boxes[:, 2:] / 2)[None]
        inside = (away[..., 0] ** 2 + away[..., 1] ** 2 <= (radii * radii)[:, None]).any(
            axis=0
        ) & self.free
        inside &= fg.areas < _MINOR * min(1e9, float((boxes[:, 2] * boxes[:, 3]).min()))
        return np.union1d(blobs, np.flatnonzero(inside)) if inside.any() else blobs

    def _bins(self, cut: Cut) -> Bins | None:
        image = self._frame.image()
        if image is None:
            return None
        rows, columns = cut.own.shape
        height, width = image.shape[:2]
        out = np.zeros((rows, columns), np.uint16)
        a, b = max(0, cut.left), max(0, cut.top)
        c, d = min(width, cut.left + columns), min(height, cut.top + rows)
        if c > a and d > b:
            out[b - cut.top : d - cut.top, a - cut.left : c - cut.left] = bins_of(
                image[b:d, a:c]
            )
        return out

    def _lone(
        self, owner: NDArray[np.uint16], rows: Rows, blobs: Rows, fits: Bools, cut: Cut
    ) -> dict[int, int]:
        """{claimant: blob}: every pixel of the blob is its own, and it has no other pixel."""
        count = len(rows)
        owned = np.flatnonzero(owner)
        table = np.bincount(
            cut.labels.take(owned).astype(np.intp) * (count + 1) + owner.take(owned),
            minlength=(len(self._fg.components) + 1) * (count + 1),
        ).reshape(-1, count + 1)
        whole: dict[int, int] = {}
        for blob in blobs.tolist():
            counts = table[blob + 1]
            k = int(np.argmax(counts[1:])) + 1
            every = 0 < int(self._fg.areas[blob]) <= counts[k] == table[:, k].sum()
            if every and fits[k - 1, blob]:
                whole[k - 1] = blob
        return whole

    def _agree(self, rows: Rows, blobs: Rows) -> None:
        """Boxes as they were detected, where as many bodies were detected in the blobs as objects
        are found there.

        A detection that has its blob for itself is but the blob again, and tells nothing of
        bodies in it.
        """
        blob_of = self._frame.detection_blobs
        inside = np.flatnonzero((blob_of[:, None] == blobs + 1).any(axis=1))
        mine = [int(row) for row in rows if int(row) in self.found]
        if len(inside) != len(mine) or not mine:
            return
        boxes = self._frame.detection_boxes[inside]
        overlap = iou(np.array([self.found[row].box for row in mine]), boxes)
        pairs = assign(1.0 - overlap, overlap >= self._p.agreement)
        if len(pairs) < len(mine):
            return
        for k, m in pairs:
            at = self.found[mine[k]]
            if not at.alone and np.count_nonzero(blob_of == blob_of[inside[m]]) > 1:
                x, y, w, h = boxes[m].tolist()
                at.box, at.place, at.sized = (x, y, w, h), (x + w / 2, y + h / 2), True

    def _deny_strangers(
        self,
        items: Sequence[Body],
        owner: NDArray[np.uint16],
        bins: Bins | None,
        whole: dict[int, int],
    ) -> None:
        """One that was hidden comes back only to pixels of its own colours; and nobody goes on with
        pixels that are unlike its own and like a rival's.
        """
        for index, body in enumerate(items):
            if index in whole and not body.front:
                continue
            own = owner == index + 1
            count = int(np.count_nonzero(own))
            like = not body.front or count >= self._p.min_back * body.area
            if like and bins is not None and body.colours is not None and count:
                seen = histogram(bins, own)
                away = distance(seen, body.colours)
                like = away <= self._p.recover or (
                    not body.front
                    and not any(
                        distance(seen, other.colours) <= self._p.recover
                        for other in items
                        if other is not body and other.colours is not None
                    )
                )
            if not like:
                owner[own] = 0
                whole.pop(index, None)

    def _measure(
        self,
        rows: Rows,
        who: Claimants,
        owner: NDArray[np.uint16],
        members: Members,
        cut: Cut,
        whole: dict[int, int],
    ) -> None:
        depth = Depth(who, owner, cut)
        counts = np.bincount(owner.ravel(), minlength=len(rows) + 1)[1:].tolist()
        if self._p.soft:
            # Whoever was denied its pixels has none to share.
            counts = [
                share if own else 0
                for share, own in zip(members.counts.tolist(), counts, strict=True)
            ]
        means = members.means
        ids = [self._bodies.items[int(row)].id for row in rows]
        shares = [
            pixels / max(1.0, self._bodies.items[int(r)].area)
            for pixels, r in zip(counts, rows, strict=True)
        ]
        for j, k in combinations(range(len(rows)), 2):
            lead = depth.lead(j, k, shares)
            if lead is not None:
                self.leads[ids[j], ids[k]] = lead
        for k, row in enumerate(rows.tolist()):
            if k in whole:
                self.found[row] = self.whole(row, whole[k])
                continue
            body = self._bodies.items[row]
            own = owner == k + 1
            count, visible = counts[k], min(1.0, shares[k])
            rivals = depth.covering(k)
            if visible < self._p.min_own:
                if rivals:
                    self.fronts[row] = ids[rivals[0][0]]
                continue
            x, y, w, h = who.boxes[k].tolist()
            mean = (float(means[k, 0]), float(means[k, 1]))
            # E[P] of what is visible, and the placed mask for what is not.
            mx, my = mean[0] - body.centroid[0] * w, mean[1] - body.centroid[1] * h
            share = (
                0.0
                if math.isnan(mx)
                else 1.0 - self._p.yielding * min(1.0, (1.0 - visible) * 2)
            )
            cx = share * mx + (1 - share) * (x + w / 2)
            cy = share * my + (1 - share) * (y + h / 2)
            blob = int(np.argmax(np.bincount(cut.labels[own], minlength=1)))
            covered = any(pixels > 0.5 for _, pixels in rivals)
            weight = 1.0 - self._p.yielding * min(0.75, 1.0 - visible)
            self.found[row] = Resolved(
                box=(cx - w / 2, cy - h / 2, w, h),
                place=(cx, cy),
                weight=weight,
                sized=False,
                alone=False,
                blob=blob,
                visible=visible,
                pixels=round(count),
                ellipse=_ellipse(own, cut),
                own=own,
                left=cut.left,
                top=cut.top,
                misfit=len(rows) == 1,
            )
            grown = extent(own, cut)
            if (
                visible >= 0.8
                and count <= self._p.larger * body.area
                and grown is not None
                and not covered
            ):
                x, y, w, h = grown
                self.found[row].box, self.found[row].place = grown, (x + w / 2, y + h / 2)
                self.found[row].sized = True


def _ellipse(own: Bools, cut: Cut) -> Ellipse | None:
    return (
        ellipse_of(own.view(np.uint8), float(cut.left), float(cut.top))
        if own.any()
        else None
    )
