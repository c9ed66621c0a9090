"""Boxes beside pictures in the forms that annotation tools write: each picture has its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from recorders.errors import SourceError, UsageError
from recorders.messages import Box
from recorders.sources import open_source

FRAMES, WIDTH, HEIGHT = 9, 64, 48
PLAIN = [f"{k + 1:04d}" for k in range(FRAMES)]
LATER = [f"{k + 101:04d}" for k in range(FRAMES)]
TIMES = [f"{1_750_000_000 + k * 0.04:.2f}" for k in range(FRAMES)]
EXPORTED = [
    f"walk_{k + 1:04d}_jpg.rf.{(k * 7919 + 345) % 997:03d}a{9 - k}" for k in range(FRAMES)
]


def box(k: int) -> Box:
    return 4.0 + 3 * k, 10.0, 12.0, 20.0


def pictures(folder: Path, names: list[str]) -> Path:
    folder.mkdir(parents=True)
    for name in names:
        image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        (folder / f"{name}.jpg").write_bytes(cv2.imencode(".jpg", image)[1].tobytes())
    return folder


def files(folder: Path, names: list[str], text: Callable[[int], str], suffix: str) -> Path:
    folder.mkdir(parents=True)
    for k, name in enumerate(names):
        (folder / f"{name}{suffix}").write_text(text(k))
    return folder


def document(path: Path, content: Any) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def shares(*values: float) -> str:
    """x and y in turn as shares of the picture."""
    return " ".join(f"{v / (HEIGHT if i % 2 else WIDTH):.8f}" for i, v in enumerate(values))


def centred(k: int) -> str:
    x, y, w, h = box(k)
    return f"0 {shares(x + w / 2, y + h / 2, w, h)}"


def outline(k: int, *more: tuple[float, float]) -> list[tuple[float, float]]:
    x, y, w, h = box(k)
    return [(x, y), (x + w, y), *more, (x + w, y + h), (x, y + h)]


def polygon(k: int) -> str:
    flat = [v for point in outline(k, (8.0 + 3 * k, 12.0)) for v in point]
    return f"1 {shares(*flat)}"


def percent(k: int) -> dict[str, float]:
    x, y, w, h = box(k)
    names = ("x", "y", "width", "height")
    sizes = (WIDTH, HEIGHT) * 2
    return {n: v * 100 / s for n, v, s in zip(names, (x, y, w, h), sizes, strict=True)}


def coco(names: list[str], **more: Any) -> dict[str, Any]:
    images = [
        {"id": 70 - k, "file_name": f"walk/{name}.jpg", "width": WIDTH, "height": HEIGHT}
        for k, name in enumerate(names)
    ]
    entries = [
        {"image_id": 70 - k, "bbox": list(box(k)), **more} for k in range(len(names))
    ]
    return {"images": images, "annotations": entries}


def runs(k: int) -> dict[str, Any]:
    """A mask as COCO writes it: runs down the columns."""
    x, y, w, h = map(int, box(k))
    counts = [x * HEIGHT + y]
    for column in range(w):
        counts += [h, HEIGHT - h] if column < w - 1 else [h]
    counts.append(WIDTH * HEIGHT - sum(counts))
    return {"size": [HEIGHT, WIDTH], "counts": counts}


def masks(names: list[str]) -> dict[str, Any]:
    found = coco(names)
    for k, entry in enumerate(found["annotations"]):
        del entry["bbox"]
        entry["segmentation"] = runs(k)
    return found


def cvat(names: list[str], shape: Callable[[int], str]) -> str:
    last = len(names) - 1
    images = "".join(
        f'<image id="{last - k}" name="cam/{name}.jpg">{shape(k)}</image>'
        for k, name in enumerate(names)
    )
    return f"<annotations>{images}</annotations>"


def cvat_box(k: int) -> str:
    x, y, w, h = box(k)
    return f'<box label="p" xtl="{x}" ytl="{y}" xbr="{x + w}" ybr="{y + h}"/>'


def cvat_turned(k: int) -> str:
    x, y, w, h = box(k)
    cx, cy = x + w / 2, y + h / 2
    corners = f'xtl="{cx - h / 2}" ytl="{cy - w / 2}" xbr="{cx + h / 2}" ybr="{cy + w / 2}"'
    return f'<box label="p" rotation="90" {corners}/>'


def cvat_polygon(k: int) -> str:
    points = ";".join(f"{x},{y}" for x, y in outline(k))
    return f'<polygon label="p" points="{points}"/>'


def tasks(names: list[str], result: Callable[[int], dict[str, Any]], key: str) -> list[Any]:
    size = {"original_width": WIDTH, "original_height": HEIGHT}
    return [
        {"data": {"image": f"/data/upload/7/3fa{k}-{name}.jpg"}, key: [{"result": [{**size, **result(k)}]}]}
        for k, name in enumerate(names)
    ]  # fmt: skip


def rectangle(k: int) -> dict[str, Any]:
    return {"type": "rectanglelabels", "value": {**percent(k), "rectanglelabels": ["p"]}}


def turned(k: int) -> dict[str, Any]:
    x, y, w, h = box(k)
    value = {
        "x": (x + w) * 100 / WIDTH, "y": y * 100 / HEIGHT, "rotation": 90,
        "width": h * 100 / WIDTH, "height": w * 100 / HEIGHT,
    }  # fmt: skip
    return {"type": "rectanglelabels", "value": value}


def table(names: list[str]) -> str:
    lines = [
        f'"{name}.jpg",{",".join(map(str, box(k)))},"a, b"' for k, name in enumerate(names)
    ]
    return "\n".join(["file_name,x,y,w,h,label", *lines])


Make = Callable[[Path, list[str]], Path]
FORMS: dict[str, Make] = {
    "yolo": lambda p, n: files(p, n, centred, ".txt"),
    "yolo, scores": lambda p, n: files(p, n, lambda k: f"{centred(k)} 0.8", ".txt"),
    "yolo, identities": lambda p, n: files(p, n, lambda k: f"{centred(k)} 17", ".txt"),
    "yolo, polygons": lambda p, n: files(p, n, polygon, ".txt"),
    "yolo, bodies": lambda p, n: files(
        p, n, lambda k: centred(k) + " .1 .1 2" * 17, ".txt"
    ),
    "coco": lambda p, n: document(p.with_suffix(".json"), coco(n)),
    "coco, masks": lambda p, n: document(p.with_suffix(".json"), masks(n)),
    "cvat": lambda p, n: document(p.with_suffix(".xml"), cvat(n, cvat_box)),
    "cvat, turned": lambda p, n: document(p.with_suffix(".xml"), cvat(n, cvat_turned)),
    "cvat, polygons": lambda p, n: document(p.with_suffix(".xml"), cvat(n, cvat_polygon)),
    "label studio": lambda p, n: document(
        p.with_suffix(".json"), tasks(n, rectangle, "annotations")
    ),
    "label studio, turned": lambda p, n: document(
        p.with_suffix(".json"), tasks(n, turned, "annotations")
    ),
    "label studio, predictions": lambda p, n: document(
        p.with_suffix(".json"), tasks(n, rectangle, "predictions")
    ),
    "a table": lambda p, n: document(p.with_suffix(".csv"), table(n)),
}


def boxes_of(source: Any) -> list[list[Box]]:
    return [f.detections.boxes for f in source.frames()]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "names", [PLAIN, LATER, TIMES, EXPORTED], ids=["plain", "later", "times", "export"]
)
def test_every_picture_has_its_own_boxes(
    tmp_path: Path, form: str, names: list[str]
) -> None:
    folder = pictures(tmp_path / "img", names)
    source = open_source(folder, detections=FORMS[form](tmp_path / "found", names), fps=25)
    found = boxes_of(source)
    assert [len(boxes) for boxes in found] == [1] * FRAMES
    for k, ((one,),) in enumerate(zip(found, strict=True)):
        assert one == pytest.approx(box(k), abs=1e-3)
    assert source.losses == []


ROWS = [(k + 1, 1, *box(k), 0.9) for k in range(FRAMES)]


def joined(separator: str, comma: bool = False) -> str:
    cells = [[str(v).replace(".", ",") if comma else str(v) for v in row] for row in ROWS]
    return "\n".join(separator.join(row) for row in cells)


@pytest.mark.parametrize(
    "text",
    [
        joined("\t", comma=True),
        joined(" ", comma=True),
        joined(";", comma=True),
        joined("   "),
        "frame,cx,cy,w,h\n"
        + "\n".join(
            f"{f - 1},{x + w / 2},{y + h / 2},{w},{h}" for f, _, x, y, w, h, _ in ROWS
        ),
    ],
    ids=["tabs", "blanks", "semicolons", "spaces", "centres"],
)
def test_tables_of_every_cut(tmp_path: Path, text: str) -> None:
    path = document(tmp_path / "found.txt", text)
    found = boxes_of(open_source(path, size=(WIDTH, HEIGHT), fps=25))
    assert found == [[box(k)] for k in range(FRAMES)]


def test_a_list_of_boxes_for_each_frame(tmp_path: Path) -> None:
    lines = [
        {
            "frame": k,
            "detections": [{"box": dict(zip("xywh", box(k), strict=True)), "name": "p"}],
        }
        for k in range(FRAMES)
    ]
    path = document(tmp_path / "found.jsonl", "\n".join(map(json.dumps, lines)))
    found = boxes_of(open_source(path, size=(WIDTH, HEIGHT), fps=25))
    assert found == [[box(k)] for k in range(FRAMES)]


def test_shares_are_asked_for_not_taken_as_pixels(tmp_path: Path) -> None:
    rows = [f"{k},.1,.2,.3,.4" for k in range(FRAMES)]
    path = document(tmp_path / "a.csv", "\n".join(["frame,xmin,ymin,xmax,ymax", *rows]))
    with pytest.raises(UsageError, match="all boxes lie between 0 and 1"):
        open_source(path, size=(WIDTH, HEIGHT), fps=25)
    found = coco(PLAIN, bbox=[0.1, 0.2, 0.3, 0.4])
    with pytest.raises(SourceError, match="as shares of the picture do; COCO has pixels"):
        open_source(document(tmp_path / "a.json", found), fps=25)


def test_what_has_no_box_is_told(tmp_path: Path) -> None:
    shape = '<points label="q" points="1,2"/>'
    path = document(tmp_path / "a.xml", cvat(PLAIN, lambda k: cvat_box(k) + shape))
    source = open_source(path, size=(WIDTH, HEIGHT), fps=25)
    assert len(boxes_of(source)) == FRAMES
    assert source.losses == ["a shape without a box (points): 9 times, the first at a.xml"]
