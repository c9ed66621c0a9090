"""Boxes in JSON documents: COCO, Frigate's events, and what else tells itself by its names."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from recorders.errors import SourceError
from recorders.formats.boxes import NOBODY, BoxRow
from recorders.formats.columns import number
from recorders.formats.document import Document
from recorders.formats.file_names import FrameNames
from recorders.formats.label_studio import LabelStudio, is_label_studio
from recorders.formats.readers import read_json
from recorders.formats.records import rows_in
from recorders.formats.run_lengths import box_of_runs
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.names import by_number
from recorders.upright import box_around

CROWD = "a crowd, which is no single object"
"""What is told of an annotation that stands for many."""


class Coco(Document):
    """COCO: a data set with ``images`` and ``annotations``, or a list of results."""

    name = "COCO"

    def __init__(
        self,
        path: Path,
        document: Any,
        size: tuple[int, int] | None = None,
        pictures: FrameNames | None = None,
    ) -> None:
        super().__init__(path, size)
        self._names = pictures or FrameNames()
        if isinstance(document, list):
            entries, images, names = document, {}, {}
            self.is_certain = False
            texts = [e.get("image_id") for e in entries if isinstance(e, dict)]
            self._names.learn([text for text in texts if isinstance(text, str)])
        else:
            entries = _listed(document, "annotations", path)
            images = self._images(_listed(document, "images", path))
            names = {
                category.get("id"): str(category.get("name", ""))
                for category in document.get("categories", [])
                if isinstance(category, dict)
            }
        for index, one in enumerate(entries):
            where = f"{path.name}, annotation {index + 1}"
            try:
                frame = one["image_id"]
                frame = images[frame] if images else self._frame_of(frame)
                box = _box_of(one)
                if one.get("iscrowd") == 1:
                    self.ignored.append(BoxRow(frame, NOBODY, box))
                    self._bad.append((CROWD, where))
                    continue
                score = one.get("score", 1.0)
                label = names.get(one.get("category_id"), one.get("category_id", ""))
                identity = one.get("track_id", NOBODY)
                row = BoxRow(
                    frame,
                    identity if isinstance(identity, int) else NOBODY,
                    box,
                    number(score, "score"),
                    str(label),
                )
            except KeyError as error:
                self._bad.append((f"an annotation without {error.args[0]}", where))
                continue
            except (TypeError, ValueError, AttributeError) as error:
                self._bad.append((f"an annotation that is none ({error})", where))
                continue
            self._take(row, where)
        if not entries:
            raise SourceError("no annotations in this COCO file", path)

    def _images(self, images: list[Any]) -> dict[Any, int]:
        """Each image's frame: the number in its name, or its place by name where there is none."""
        named = [image for image in images if isinstance(image, dict) and "id" in image]
        sizes = {(image.get("width"), image.get("height")) for image in named}
        if len(sizes) == 1:
            width, height = next(iter(sizes))
            if isinstance(width, int) and isinstance(height, int) and width > 0 < height:
                self.size = width, height
        files = {image["id"]: str(image.get("file_name", image["id"])) for image in named}
        self._names.learn(files.values())
        numbers: dict[Any, int] = {}
        for identity, file in files.items():
            with suppress(ValueError):
                numbers[identity] = self._names.frame(file)
        if files and len(set(numbers.values())) == len(files):
            self.first_frame = self._names.first_frame
            return numbers
        order = sorted(files, key=lambda identity: by_number(files[identity]))
        return {identity: place for place, identity in enumerate(order)}

    def _frame_of(self, value: Any) -> int:
        return value if isinstance(value, int) else self._names.frame(str(value))


def _box_of(annotation: dict[str, Any]) -> tuple[float, float, float, float]:
    """An annotation's box; that around its polygons or its mask where it has none of its own."""
    polygons = annotation.get("segmentation")
    if annotation.get("bbox") or not polygons:
        x, y, w, h = (number(value, "bbox") for value in annotation["bbox"])
        return x, y, w, h
    if isinstance(polygons, dict):
        return box_of_runs(polygons)
    xs = [number(value, "segmentation") for polygon in polygons for value in polygon[::2]]
    ys = [number(value, "segmentation") for polygon in polygons for value in polygon[1::2]]
    return box_around(xs, ys)


def _listed(document: Any, name: str, path: Path) -> list[Any]:
    found = document.get(name)
    if not isinstance(found, list):
        raise SourceError(f"its {name} are no list", path)
    return found


class Frigate(Document):
    """Frigate's events, as its API gives them (one box an event, at its start) or as they are
    published (each update with its box); their times become frames at the given rate.
    """

    name = "Frigate events"

    def __init__(
        self,
        path: Path,
        events: list[Any],
        size: tuple[int, int] | None,
        fps: float,
    ) -> None:
        super().__init__(path, size)
        self.notes.append(f"the events' times were put into frames of {fps:g} per second")
        found = [e.get("after", e) for e in events if isinstance(e, dict)]
        times = [e.get("frame_time") or e.get("start_time") for e in found]
        known = [moment for moment in times if isinstance(moment, int | float)]
        first = min(known, default=0.0)
        if any("frame_time" not in e for e in found):
            self.notes.append("each event gives one box, at its start")
        for index, (event, time) in enumerate(zip(found, times, strict=True)):
            where = f"{path.name}, event {index + 1}"
            try:
                frame = round((float(time) - first) * fps)
                row = BoxRow(
                    frame,
                    NOBODY,
                    self._box(event),
                    _score(event),
                    str(event.get("label", "")),
                )
            except (KeyError, TypeError, ValueError) as e:
                self._bad.append((f"an event without a box ({type(e).__name__})", where))
                continue
            self._take(row, where)

    def _box(self, event: Any) -> tuple[float, float, float, float]:
        box = event.get("box") or (event.get("data") or {}).get("box")
        if not isinstance(box, list):
            raise KeyError("box")
        a, b, c, d = (number(value, "box") for value in box)
        if max(a, b, c, d) > 1:
            return a, b, c - a, d - b  # published updates: two corners in pixels
        if self._picture is None:
            raise SourceError(
                "its boxes are shares of a picture whose size it does not say: say it with"
                " --size",
                self.path,
            )
        width, height = self._picture
        return a * width, b * height, c * width, d * height


def _score(event: Any) -> float:
    data = event.get("data") or {}
    value = event.get("score") or event.get("top_score") or data.get("score") or 1.0
    return number(value, "score")


def document_of(
    path: Path,
    size: tuple[int, int] | None,
    fps: float,
    limits: Limits = DEFAULT_LIMITS,
    pictures: FrameNames | None = None,
) -> Document | None:
    """A JSON document by what is in it; None for a list of rows with named values.

    Raises:
        SourceError: it is none of the formats that are known.
    """
    found = read_json(path, limits)
    if isinstance(found, dict) and {"images", "annotations"} <= set(found):
        return Coco(path, found, size, pictures)
    if not isinstance(found, list) and rows_in(found):
        return None
    if not isinstance(found, list):
        what = (
            ", ".join(list(found)[:6]) if isinstance(found, dict) else type(found).__name__
        )
        raise SourceError(
            f"not a JSON of boxes that is known (COCO, Label Studio, Frigate events, a list of"
            f" rows); it holds {what}",
            path,
        )
    if not found:
        raise SourceError("no detections in this file", path)
    first = found[0] if isinstance(found[0], dict) else {}
    if "image_id" in first and "bbox" in first:
        return Coco(path, found, size, pictures)
    if is_label_studio(first):
        return LabelStudio(path, found, size, pictures)
    if is_frigate(first):
        return Frigate(path, found, size, fps)
    return None


def is_frigate(first: Any) -> bool:
    """Whether an object is one of Frigate's events."""
    return isinstance(first, dict) and (
        isinstance(first.get("after"), dict) or {"start_time", "label"} <= set(first)
    )
