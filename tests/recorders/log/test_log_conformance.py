"""Files that others wrote: the MCAP conformance suite against its expectations, and ROS 2 bags."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from recorders.log import LogReader, LogWriter
from recorders.log.content_digest import content_digest
from recorders.log.info import examine, inspect
from recorders.log.recovery import recover

pytestmark = pytest.mark.real


def expected_records(path: Path) -> list[tuple[str, dict[str, Any]]]:
    records = json.loads(path.with_suffix(".json").read_text())["records"]
    return [(record["type"], dict(record["fields"])) for record in records]


def octets(values: list[str]) -> bytes:
    return bytes(int(value) for value in values)


def check_against_expectation(path: Path) -> None:
    records = expected_records(path)
    of = {
        kind: [fields for name, fields in records if name == kind]
        for kind in {name for name, _ in records}
    }
    schemas = {
        s["id"]: (s["name"], s["encoding"], octets(s["data"])) for s in of.get("Schema", [])
    }
    channels = {
        int(c["id"]): (
            c["topic"],
            c["message_encoding"],
            c["metadata"],
            schemas.get(c["schema_id"]),
        )
        for c in of.get("Channel", [])
    }
    messages = [
        (
            int(m["channel_id"]),
            int(m["log_time"]),
            int(m["publish_time"]),
            int(m["sequence"]),
            octets(m["data"]),
        )
        for m in of.get("Message", [])
    ]
    with LogReader(path) as log:
        (header,) = of["Header"]
        assert (log.header.profile, log.header.library) == (
            header["profile"],
            header["library"],
        )
        assert {
            c.id: (
                c.topic,
                c.message_encoding,
                dict(c.metadata),
                None
                if c.schema is None
                else (c.schema.name, c.schema.encoding, c.schema.data),
            )
            for c in log.channels
        } == channels
        got = list(log.messages())
        assert [
            (m.channel.id, m.log_time_ns, m.publish_time_ns, m.sequence, m.data)
            for m in got
        ] == sorted(messages, key=lambda m: m[1])
        assert list(log.messages(reverse=True)) == got[::-1]
        assert log.message_count == len(messages)
        assert log.start_ns == (min(m[1] for m in messages) if messages else None)
        assert log.end_ns == (max(m[1] for m in messages) if messages else None)
        assert [
            (a.name, a.media_type, a.log_time_ns, a.create_time_ns, a.data)
            for a in log.attachments()
        ] == [
            (
                a["name"],
                a["media_type"],
                int(a["log_time"]),
                int(a["create_time"]),
                octets(a["data"]),
            )
            for a in of.get("Attachment", [])
        ]
        assert log.metadata() == [
            (m["name"], m["metadata"]) for m in of.get("Metadata", [])
        ]


def test_the_conformance_suite_reads_equal_to_its_expectations(real_data: Path) -> None:
    files = sorted((real_data / "mcap-conformance").rglob("*.mcap"))
    assert len(files) == 416
    for path in files:
        check_against_expectation(path)


def test_the_conformance_suite_has_no_errors_for_doctor(real_data: Path) -> None:
    for path in sorted((real_data / "mcap-conformance").rglob("*.mcap")):
        assert [
            finding for finding in examine(path) if finding.severity == "error"
        ] == [], path


def test_conformance_files_survive_recovery_and_rewriting(
    real_data: Path, tmp_path: Path
) -> None:
    for path in sorted((real_data / "mcap-conformance").rglob("*.mcap"))[::7]:
        report = recover(path, tmp_path / "out.mcap", force=True)
        assert report.is_complete, (path, report.losses)
        assert content_digest(tmp_path / "out.mcap") == content_digest(path)


COUNTS = {
    "cdr_test_0": 7,
    "multiple_files_0": 1324,
    "only_topics": 7,
    "talker": 20,
    "test_bag_for_seek_0": 5,
    "topics_and_services": 13,
    "wbag_0": 1246,
}


def test_ros_bags_are_read_whole(real_data: Path, tmp_path: Path) -> None:
    files = sorted((real_data / "mcap-recordings").glob("*.mcap"))
    assert {path.stem for path in files} == set(COUNTS)
    for path in files:
        info = inspect(path)
        assert (info.profile, info.message_count, info.is_indexed) == (
            "ros2",
            COUNTS[path.stem],
            True,
        )
        assert (
            sum(channel.message_count or 0 for channel in info.channels)
            == info.message_count
        )
        assert all(finding.severity == "warning" for finding in examine(path))
        with (
            LogReader(path) as log,
            LogWriter(tmp_path / path.name, profile=log.header.profile) as copy,
        ):
            ids = {
                c.id: copy.channel(c.topic, c.schema, c.message_encoding, c.metadata)
                for c in log.channels
            }
            messages = list(log.messages())
            assert [m.order for m in messages] == sorted(m.order for m in messages)
            for m in messages:
                copy.write(
                    ids[m.channel.id], m.data, m.log_time_ns, m.publish_time_ns, m.sequence
                )
        assert content_digest(tmp_path / path.name) == content_digest(path)
