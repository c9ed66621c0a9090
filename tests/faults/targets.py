"""What is fuzzed: every parser that reads what others wrote, with sound inputs to start from."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import cv2
import msgspec
import numpy as np
from mcap.writer import Writer

from reasoning.questions import Case
from reasoning.questions.patterns import parse
from recorders.annotated import checkpoint
from recorders.corrections import CorrectionsHeader, parse_corrections
from recorders.formats.opening import open_rows
from recorders.log import LogReader
from recorders.log.recovery import recover
from recorders.parameters import configure
from recorders.recording import SECTIONS
from recorders.sources.caviar import CaviarSource
from recorders.sources.regions import read_regions
from recorders.stills import decode_still, still_header
from replay.batch.sources import sources_of
from replay.sealing.manifest import read_manifest
from tests.faults.fuzz import Target
from tests.faults.small import annotated, run

_ROWS = {
    "mot.txt": b"1,1,10,20,30,40,0.9,-1,-1,-1\n2,1,11.5,20,30,40,0.8,-1,-1,-1\n",
    "named.csv": b"frame,x1,y1,x2,y2,score,class\n0,1,2,30,40,.5,car\n1,2,2,31,40,.5,car\n",
    "lines.jsonl": b'{"frame": 1, "x": 1, "y": 2, "w": 3, "h": 4}\n{"frame": 2, "x": 1, "y": 2, "w": 3, "h": 4}\n',
    "coco.json": json.dumps(
        {
            "images": [{"id": 1, "file_name": "1.jpg", "width": 640, "height": 480}],
            "annotations": [
                {
                    "id": 1,
                    "image_id": 1,
                    "category_id": 1,
                    "bbox": [1, 2, 30, 40],
                    "score": 0.5,
                }
            ],
            "categories": [{"id": 1, "name": "person"}],
        }
    ).encode(),
    "studio.json": json.dumps(
        [
            {
                "data": {"image": "a.jpg"},
                "annotations": [
                    {
                        "result": [
                            {
                                "type": "rectanglelabels",
                                "original_width": 640,
                                "original_height": 480,
                                "value": {
                                    "x": 1,
                                    "y": 2,
                                    "width": 10,
                                    "height": 20,
                                    "rectanglelabels": ["a"],
                                },
                            }
                        ]
                    }
                ],
            }
        ]
    ).encode(),
    "cvat.xml": b'<annotations><track id="0" label="p"><box frame="0" xtl="1" ytl="2" xbr="30"'
    b' ybr="40" outside="0" occluded="0" keyframe="1"/></track></annotations>',
}
_CAVIAR = b"""<dataset name="x"><frame number="0"><objectlist><object id="0"><orientation>1</orientation>
<box xc="10" yc="20" w="30" h="40"/><appearance>appear</appearance></object></objectlist></frame></dataset>"""


def targets(folder: Path) -> dict[str, tuple[Sequence[bytes], Target]]:
    """Each target: sound inputs, and what reads one."""
    log = annotated(folder)
    data = log.read_bytes()
    with LogReader(log) as opened:
        messages = {m.topic: m.data for m in opened.messages()}
    case = Case([log])
    picture = np.full((24, 32, 3), 90, np.uint8)
    stills = [
        cv2.imencode(ext, picture)[1].tobytes()
        for ext in (".png", ".jpg", ".webp", ".tiff")
    ]
    found: dict[str, tuple[Sequence[bytes], Target]] = {
        "log": ([data], _log),
        "recover": ([data], _recover),
        "pictures": (stills, _still),
        "CAVIAR": ([_CAVIAR], _caviar),
        "regions": (
            [
                b'{"roi": [[0, 0], [99, 0], [99, 99]], "zones": {"door": [[1, 1], [9, 1], [9, 9]]}}'
            ],
            _regions,
        ),
        "configuration": ([b"[segmentation]\nthreshold_levels = 20\n"], _configuration),
        "patterns": (
            [b"meeting(a,b) ; joint(a,b)[>2s] ; exited(a)[<30s]", b"stay(a, door)[1s..3s]"],
            lambda text, _: parse(text.decode("utf-8", "replace")),
        ),
        "SQL": (
            [
                b"SELECT kind, t FROM events ORDER BY t",
                b"WITH x AS (SELECT * FROM tracks) SELECT count(*) FROM x JOIN frames USING (frame)",
            ],
            lambda text, _: case.rows(text.decode("utf-8", "replace")),
        ),
        "checkpoints": (
            [_checkpoint(log)],
            lambda text, _: checkpoint.decode(text, "checkpoint"),
        ),
        "manifests": (
            [
                b'{"format": "1", "files": [{"name": "a", "sha256": "00", "bytes": 1, "role": "file"}]}'
            ],
            _manifest,
        ),
        "corrections": ([_corrections()], _correction),
        "lists of sources": ([b"# all\n'a b.mp4' --camera x\n"], _sources),
    }
    for name, seed in _ROWS.items():
        found[f"boxes ({name})"] = ([seed], _rows(name))
    for topic in ("detections", "tracks", "events", "graph"):
        found[f"messages ({topic})"] = (
            [messages[f"/camera/{topic}"]],
            _message(topic, log),
        )
    return found


def _checkpoint(log: Path) -> bytes:
    """A checkpoint of a replay."""
    scene, out = log.with_name("scene.mcap"), log.with_name("checked.mcap")
    assert run("replay", str(scene), "-o", str(out), "--checkpoint", "0.2")[0] == 0
    with LogReader(out) as opened:
        found = [
            extra for extra in opened.attachments() if extra.name.startswith("checkpoint")
        ]
    return found[0].data


def _corrections() -> bytes:
    head = CorrectionsHeader("corrections", 1, "x.mcap", "camera", "events")
    return (
        msgspec.json.encode(head)
        + b'\n{"kind": "delete", "ids": [1], "by": "me", "why": "x"}\n'
    )


def _log(data: bytes, folder: Path) -> None:
    from tests.faults.damage import answers

    path = folder / "fuzzed.mcap"
    path.write_bytes(data)
    answers(path)


def _recover(data: bytes, folder: Path) -> None:
    path, out = folder / "fuzzed.mcap", folder / "recovered.mcap"
    path.write_bytes(data)
    recover(path, out, force=True)


def _still(data: bytes, folder: Path) -> None:
    header = still_header(data, folder / "picture")
    if header.width * header.height <= 1 << 22:
        decode_still(data, header, path=folder / "picture")


def _rows(name: str) -> Target:
    def read(data: bytes, folder: Path) -> None:
        path = folder / name
        path.write_bytes(data)
        for _ in open_rows(path, (640, 480)).rows(lambda *_: None):
            pass

    return read


def _caviar(data: bytes, folder: Path) -> None:
    path = folder / "caviar.xml"
    path.write_bytes(data)
    for _ in CaviarSource(path).frames():
        pass


def _regions(data: bytes, folder: Path) -> None:
    path = folder / "regions.json"
    path.write_bytes(data)
    read_regions(path, 640, 480)


def _configuration(data: bytes, folder: Path) -> None:
    path = folder / "config.toml"
    path.write_bytes(data)
    configure(SECTIONS, path)


def _manifest(data: bytes, folder: Path) -> None:
    path = folder / "manifest.json"
    path.write_bytes(data)
    read_manifest(path)


def _correction(data: bytes, folder: Path) -> None:
    parse_corrections(data.decode("utf-8", "replace"), folder / "corrections.jsonl")


def _sources(data: bytes, folder: Path) -> None:
    if b"/" in data or b".." in data:
        return  # another folder of this machine, or another machine
    path = folder / "list.txt"
    path.write_bytes(data)
    sources_of([f"@{path}"])


def _message(topic: str, log: Path) -> Target:
    """A log whose last message of a topic is that of a fuzzer: sound as MCAP, wrong inside."""
    from tests.faults.damage import answers

    before, after = _around(topic, log)

    def read(data: bytes, folder: Path) -> None:
        path = folder / "within.mcap"
        head = before[-_MESSAGE_HEAD:]
        size = struct.pack("<BQ", _MESSAGE, len(head) + len(data))
        path.write_bytes(b"".join([before[:-_MESSAGE_HEAD], size, head, data, after]))
        answers(path)

    return read


_MESSAGE, _MESSAGE_HEAD = 5, 22


def _around(topic: str, log: Path) -> tuple[bytes, bytes]:
    """What stands before the data of the topic's last message, but for opcode and length of its
    record, and what stands after it, in the log without chunks and without a summary.
    """
    out = BytesIO()
    writer = Writer(out, use_chunking=False)
    places = []
    with LogReader(log) as opened:
        writer.start()
        ids = {}
        for c in opened.channels:
            assert c.schema is not None
            schema = writer.register_schema(c.schema.name, c.schema.encoding, c.schema.data)
            ids[c.id] = writer.register_channel(
                c.topic, c.message_encoding, schema, dict(c.metadata)
            )
        for name, values in opened.metadata():
            writer.add_metadata(name, dict(values))
        for m in opened.messages():
            if m.topic.endswith(f"/{topic}"):
                places.append((out.tell(), len(m.data)))
            writer.add_message(
                ids[m.channel.id], m.log_time_ns, m.data, m.publish_time_ns, m.sequence
            )
    place, size = places[-1]
    end = out.tell()
    ending = struct.pack("<BQI", 15, 4, 0) + struct.pack("<BQQQI", 2, 20, 0, 0, 0)
    written = out.getvalue()
    assert written[place] == _MESSAGE
    head = place + 9
    return (
        written[:place] + written[head : head + _MESSAGE_HEAD],
        written[head + _MESSAGE_HEAD + size : end] + ending + written[:8],
    )
