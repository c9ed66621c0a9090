"""Label Studio's JSON: its export, its short export, and predictions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from recorders.errors import LimitError, SourceError
from recorders.formats.boxes import NOBODY, BoxRow
from recorders.formats.columns import number
from recorders.formats.document import Document
from recorders.formats.file_names import FrameNames
from recorders.upright import box_around, extent_of_ellipse

_LISTS = ("annotations", "completions")
_BOXED = (
    "rectanglelabels",
    "polygonlabels",
    "ellipselabels",
    "labels",
    "rectangle",
    "polygon",
    "ellipse",
)
Corners = list[tuple[float, float]]


def is_label_studio(task: dict[str, Any]) -> bool:
    """Whether a list's first entry is a task: with annotations, with predictions, or short."""
    if any(name in task for name in (*_LISTS, "predictions")):
        return True
    return any(
        isinstance(value, list)
        and bool(value)
        and isinstance(value[0], dict)
        and any(name in value[0] for name in _BOXED)
        for value in task.values()
    )


class LabelStudio(Document):
    """Rectangles, polygons and ellipses of pictures; rectangles of videos with key frames between
    which boxes move evenly. Predictions where nobody annotated anything.
    """

    name = "Label Studio JSON"
    first_frame: int | None = None
    is_certain = False

    def __init__(
        self,
        path: Path,
        document: list[Any],
        size: tuple[int, int] | None = None,
        pictures: FrameNames | None = None,
    ) -> None:
        super().__init__(path, size)
        self._names = pictures or FrameNames()
        named = [name for name in map(_named, document) if name]
        self._names.learn(named)
        if named and not any(name.lower().endswith(_VIDEOS) for name in named):
            self.first_frame = self._names.first_frame
        results = [list(_results(task, _LISTS)) for task in document]
        if not any(results):
            results = [list(_results(task, ("predictions",))) for task in document]
            if any(results):
                self.notes.append(f"{path.name}: no annotations, its predictions are taken")
        for place, found in enumerate(results):
            for result in found:
                self._try(document[place], place, result)

    def _try(self, task: Any, place: int, result: Any) -> None:
        where = f"task {place + 1}"
        try:
            self._result(task, place, result)
        except KeyError as error:
            self._bad.append((f"a result without {error.args[0]}", where))
        except (TypeError, ValueError, AttributeError, OverflowError) as error:
            self._bad.append((f"a result that is none ({error})", where))

    def _result(self, task: Any, place: int, result: Any) -> None:
        value = result.get("value", result)
        names: list[Any] = next(
            (value[name] for name in _BOXED if isinstance(value.get(name), list)), []
        )
        label = str(names[0]) if names else ""
        score = number(result.get("score") or 1.0, "score")
        if "sequence" in value:
            size = self._size_of(result)
            claimed = _claimed(value["sequence"], value.get("framesCount"))
            if len(self._found) + claimed > _MOST_BOXES:
                raise LimitError(f"over {_MOST_BOXES} boxes in its videos", self.path)
            for frame, box in _between(value["sequence"], value.get("framesCount")):
                row = BoxRow(frame, NOBODY, _box(_rectangle(box, 0.0, size)), score, label)
                self._take(row, f"task {place + 1}, frame {frame}")
            return
        corners = self._corners(value, result)
        if corners is None:
            kind = result.get("type") or "of another kind"
            self._bad.append((f"a result without a box ({kind})", f"task {place + 1}"))
            return
        try:
            frame = self._names.frame(_named(task))
        except ValueError:
            frame = place
        self._take(BoxRow(frame, NOBODY, _box(corners), score, label), f"task {place + 1}")

    def _corners(self, value: Any, result: Any) -> Corners | None:
        """The outline of a result in pixels; None where it has none."""
        kind = str(result.get("type") or "")
        turn = number(value.get("rotation") or 0.0, "rotation")
        if "keypoint" in kind or "brush" in kind or "keypointlabels" in value:
            return None
        if isinstance(value.get("points"), list):
            width, height = self._size_of(result)
            return [
                (number(x, "x") * width / 100, number(y, "y") * height / 100)
                for x, y in value["points"]
            ]
        if "radiusX" in value:
            x, y, a, b = (number(value[n], n) for n in ("x", "y", "radiusX", "radiusY"))
            return _ellipse(x, y, a, b, turn, self._size_of(result))
        if "width" not in value:
            return None
        box = tuple(number(value[name], name) for name in ("x", "y", "width", "height"))
        return _rectangle(box, turn, self._size_of(result))

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


_MOST_BOXES = 2_000_000
"""Between key frames: a few words of a file claim any number of them."""
_VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg")


def _results(task: Any, lists: tuple[str, ...]) -> Iterator[Any]:
    """The results of a task that count."""
    if not isinstance(task, dict):
        return
    found = next((task[n] for n in lists if isinstance(task.get(n), list)), None)
    if found is None and "data" not in task and "predictions" not in lists:
        for value in task.values():  # the short form has them in the task itself
            if isinstance(value, list):
                yield from (one for one in value if isinstance(one, dict))
        return
    for one in found or []:
        if isinstance(one, dict) and not one.get("was_cancelled"):
            yield from one.get("result") or []


def _named(task: Any) -> str:
    """The picture that a task is about."""
    if not isinstance(task, dict):
        return ""
    data = task.get("data")
    values = data.values() if isinstance(data, dict) else task.values()
    return next((v for v in values if isinstance(v, str) and "." in v), "")


def _rectangle(box: tuple[float, ...], turn: float, size: tuple[int, int]) -> Corners:
    """The corners of a rectangle of percents, turned around its upper left one."""
    width, height = size
    x, y, w, h = (v * s / 100 for v, s in zip(box, (width, height) * 2, strict=True))
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    if not turn:
        cos, sin = 1.0, 0.0
    return [
        (x + a * cos - b * sin, y + a * sin + b * cos)
        for a, b in ((0.0, 0.0), (w, 0.0), (w, h), (0.0, h))
    ]


def _ellipse(
    x: float, y: float, a: float, b: float, turn: float, size: tuple[int, int]
) -> Corners:
    """Two corners around an ellipse of percents, turned around its centre."""
    width, height = size
    x, y, a, b = x * width / 100, y * height / 100, a * width / 100, b * height / 100
    across, down = extent_of_ellipse(a, b, math.radians(turn))
    return [(x - across, y - down), (x + across, y + down)]


def _box(corners: Corners) -> tuple[float, float, float, float]:
    return box_around([x for x, _ in corners], [y for _, y in corners])


def _claimed(sequence: list[Any], count: Any) -> int:
    """How many frames `_between` gives, or more."""
    keys = sorted(sequence, key=lambda k: k["frame"])
    if not keys:
        return 0
    to_end = isinstance(count, int) and keys[-1].get("enabled", True)
    last = max(keys[-1]["frame"], count) if to_end else keys[-1]["frame"]
    return int(last - keys[0]["frame"] + 1)


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
