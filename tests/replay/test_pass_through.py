"""What was recorded passes through a replay as it is: times, sequence numbers, bytes,
attachments, foreign channels.
"""

from __future__ import annotations

from pathlib import Path

from recorders import channels
from recorders.log import LogReader, LogWriter, Schema
from recorders.messages import Detections
from replay.annotated_writer import replay
from replay.run import ReplayOptions

FRAME_NS = 100_000_000
IMU = Schema("imu", "jsonschema", b'{"type":"object"}')


def test_every_recorded_message_is_as_it_was(tmp_path: Path) -> None:
    path, out = tmp_path / "s.mcap", tmp_path / "a.mcap"
    with LogWriter(path) as log:
        topic = channels.topic("camera", "detections")
        found = log.channel(topic, channels.schema("detections"), "json", {"lens": "wide"})
        imu = log.channel("/imu", IMU, "json", {"serial": "7"})
        log.attach("lens.txt", "text/plain", b"wide", 5, 3)
        for k in range(12):
            now = 1_000 + k * FRAME_NS
            # Between frames, at a frame's time, before and after all of them; spaces that no
            # encoder of ours writes.
            log.write(imu, b'{"a": %d }' % k, now - 7, now + 13, 40 + 3 * k)
            log.write(imu, b'{"b": %d }' % k, now, now - 11, 41 + 3 * k)
            payload = channels.encode(
                "detections", Detections(k, 64, 48, [(5.0 + k, 6.0, 10.0, 20.0)])
            )
            log.write(found, payload.replace(b":", b": "), now, now + 17, 900 - k)
        log.write(imu, b"last", now + 1, now + 2, 1)
    replay(path, out, ReplayOptions())
    with LogReader(path) as before, LogReader(out) as after:
        topics = before.topics()
        facts = [
            [
                (
                    m.topic,
                    m.log_time_ns,
                    m.publish_time_ns,
                    m.sequence,
                    m.data,
                    m.channel.schema,
                    m.channel.metadata,
                )
                for m in log.messages(topics)
            ]
            for log in (before, after)
        ]
        assert len(facts[0]) == 37
        assert facts[0] == facts[1]
        assert list(before.attachments()) == list(after.attachments())
