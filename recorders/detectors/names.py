"""What the classes of common training sets are called, for models that do not say it."""

from __future__ import annotations

COCO = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat",
    "traffic light", "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog",
    "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe", "backpack", "umbrella",
    "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard", "sports ball", "kite",
    "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket", "bottle",
    "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange",
    "broccoli", "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch", "potted plant",
    "bed", "dining table", "toilet", "tv", "laptop", "mouse", "remote", "keyboard", "cell phone",
    "microwave", "oven", "toaster", "sink", "refrigerator", "book", "clock", "vase", "scissors",
    "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip
"""COCO's 80 classes, without gaps."""
_UNUSED = (12, 26, 29, 30, 45, 66, 68, 69, 71, 83)
VOC = (
    "aeroplane", "bicycle", "bird", "boat", "bottle", "bus", "car", "cat", "chair", "cow",
    "diningtable", "dog", "horse", "motorbike", "person", "pottedplant", "sheep", "sofa", "train",
    "tvmonitor",
)  # fmt: skip


def coco_by_id() -> tuple[str, ...]:
    """COCO's classes by their published ids, 0 to 90, of which some were never used.

    >>> coco_by_id()[1], coco_by_id()[90], len(coco_by_id())
    ('person', 'toothbrush', 91)
    """
    rest = iter(COCO)
    return (
        "background",
        *(f"class {index}" if index in _UNUSED else next(rest) for index in range(1, 91)),
    )


def usual_names(count: int) -> tuple[str, ...]:
    """The names of so many classes: COCO's or VOC's where their number fits, else numbers.

    >>> usual_names(80)[0], usual_names(91)[1], usual_names(2)
    ('person', 'person', ('class 0', 'class 1'))
    """
    tables = {len(COCO): COCO, len(VOC): VOC, 91: coco_by_id()}
    return tables.get(count) or tuple(f"class {index}" for index in range(count))
