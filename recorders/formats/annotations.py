"""Boxes in the files of annotation tools: COCO, CVAT, Label Studio, Frigate's events."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from recorders.errors import SourceError
from recorders.formats.boxes import NOBODY, BoxRow
from recorders.formats.columns import number, number_in
from recorders.formats.readers import Bad, checked, read_json
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.names import by_number


class Document:
    """A document that is read whole: what the classes here share."""

    name = ""
    first_frame: int | None = 0
    is_certain = True

    def __init__(self, path: Path, size: tuple[int, int] | None = None) -> None:
        self.path = path
        self.size: tuple[int, int] | None = None
        self.notes: list[str] = []
        self._picture = size
        self._found: list[BoxRow] = []
        self._bad: list[tuple[str, str]] = []

    def _take(self, row: BoxRow, where: str) -> None:
        kept = checked(
            row, self.path, where, lambda what, why: self._bad.append((what, why))
        )
        if kept is not None:
            self._found.append(kept)

    def rows(self, bad: Bad) -> Iterator[BoxRow]:
        """See `recorders.formats.readers.RowReader`."""
        for what, where in self._bad:
            bad(what, where)
        yield from self._found

    def files(self) -> list[Path]:
        """See `recorders.formats.readers.RowReader`."""
        return [self.path]


class Coco(Document):
    """COCO: a data set with ``images`` and ``annotations``, or a list of results."""

    name = "COCO"

    def __init__(
        self,
        path: Path,
        document: Any,
        size: tuple[int, int] | None = None,
    ) -> None:
        super().__init__(path, size)
        if isinstance(document, list):
            entries, images, names = document, {}, {}
            self.is_certain = False
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
                if one.get("iscrowd") == 1:
                    self._bad.append(("a crowd, which is no single object", where))
                    continue
                frame = one["image_id"]
                frame = images[frame] if images else _frame_of(frame)
                box = _box_of(one)
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
            except (KeyError, TypeError, ValueError, AttributeError) as error:
                self._bad.append(
                    (f"an annotation that is none ({type(error).__name__})", where)
                )
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
        try:
            numbers = {identity: number_in(file) for identity, file in files.items()}
        except ValueError:
            numbers = {}
        if files and len(set(numbers.values())) == len(files):
            self.first_frame = min(1, *numbers.values())
            return numbers
        order = sorted(files, key=lambda identity: by_number(files[identity]))
        return {identity: place for place, identity in enumerate(order)}


def _box_of(annotation: dict[str, Any]) -> tuple[float, float, float, float]:
    """An annotation's box; that around its polygons where it has none of its own."""
    if annotation.get("bbox") or not isinstance(annotation.get("segmentation"), list):
        x, y, w, h = (number(value, "bbox") for value in annotation["bbox"])
        return x, y, w, h
    polygons = annotation["segmentation"]
    xs = [number(value, "segmentation") for polygon in polygons for value in polygon[::2]]
    ys = [number(value, "segmentation") for polygon in polygons for value in polygon[1::2]]
    return min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys)


def _frame_of(value: Any) -> int:
    return value if isinstance(value, int) else number_in(str(value))


def _listed(document: Any, name: str, path: Path) -> list[Any]:
    found = document.get(name)
    if not isinstance(found, list):
        raise SourceError(f"its {name} are no list", path)
    return found


class LabelStudio(Document):
    """Label Studio's JSON export: rectangles of pictures, or of videos with key frames between
    which boxes move evenly.
    """

    name = "Label Studio JSON"
    first_frame = None
    is_certain = False

    def __init__(
        self, path: Path, document: list[Any], size: tuple[int, int] | None = None
    ) -> None:
        super().__init__(path, size)
        for place, task in enumerate(document):
            for one in task.get("annotations") or task.get("completions") or []:
                for result in one.get("result") or []:
                    try:
                        self._result(task, place, result)
                    except (KeyError, TypeError, ValueError, AttributeError) as error:
                        self._bad.append(
                            (
                                f"a result that is none ({type(error).__name__})",
                                f"task {place + 1}",
                            )
                        )

    def _result(self, task: Any, place: int, result: Any) -> None:
        value = result["value"]
        labels = value.get("rectanglelabels") or value.get("labels") or [""]
        if result.get("type") == "videorectangle":
            size = self._size_of(result)
            for frame, box in _between(value["sequence"], value.get("framesCount")):
                self._take(
                    BoxRow(frame, NOBODY, _percent(box, size), 1.0, str(labels[0])),
                    f"task {place + 1}, frame {frame}",
                )
        elif "width" in value:
            data = task.get("data") or {}
            name = next((str(v) for v in data.values() if isinstance(v, str)), "")
            try:
                frame = number_in(name)
            except ValueError:
                frame = place
            box = tuple(float(value[key]) for key in ("x", "y", "width", "height"))
            self._take(
                BoxRow(
                    frame, NOBODY, _percent(box, self._size_of(result)), 1.0, str(labels[0])
                ),
                f"task {place + 1}",
            )

    def _size_of(self, result: Any) -> tuple[int, int]:
        width, height = result.get("original_width"), result.get("original_height")
        if isinstance(width, int) and isinstance(height, int):
            self.size = width, height
            return width, height
        if self._picture is None:
            raise SourceError(
                "its boxes are shares of a picture whose size it does not say: say it with"
                " --size",
                self.path,
            )
        return self._picture


def _percent(
    box: tuple[float, ...], size: tuple[int, int]
) -> tuple[float, float, float, float]:
    x, y, w, h = box
    return (
        x * size[0] / 100,
        y * size[1] / 100,
        w * size[0] / 100,
        h * size[1] / 100,
    )


def _between(sequence: list[Any], count: Any) -> Iterator[tuple[int, tuple[float, ...]]]:
    """Frame and box of every frame in which the target is there, from its key frames."""
    keys = sorted(sequence, key=lambda k: k["frame"])
    for k, key in enumerate(keys):
        box = tuple(float(key[name]) for name in ("x", "y", "width", "height"))
        frame = int(key["frame"])
        yield frame, box
        if not key.get("enabled", True):
            continue
        if k + 1 < len(keys):
            following = keys[k + 1]
            end = int(following["frame"])
            target = tuple(float(following[name]) for name in ("x", "y", "width", "height"))
            for f in range(frame + 1, end):
                share = (f - frame) / (end - frame)
                yield (
                    f,
                    tuple(a + (b - a) * share for a, b in zip(box, target, strict=True)),
                )
        elif isinstance(count, int):
            for f in range(frame + 1, count + 1):
                yield f, box


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
) -> Document | None:
    """A JSON document by what is in it; None for a list of rows with named values.

    Raises:
        SourceError: it is none of the formats that are known.
    """
    found = read_json(path, limits)
    if isinstance(found, dict) and {"images", "annotations"} <= set(found):
        return Coco(path, found, size)
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
        return Coco(path, found, size)
    if "annotations" in first or "completions" in first:
        return LabelStudio(path, found, size)
    if "after" in first or {"start_time", "label"} <= set(first):
        return Frigate(path, found, size, fps)
    return None
