"""The served desk: on this machine alone, behind its token, read only unless it may edit."""

from __future__ import annotations

import http.client
import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders.corrections import read_corrections
from replay.cases import read_notes
from replay.cli import main
from replay.viewing import Desk, DeskServer

JSON = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("view")
    made = generate("three_way_group", seed=1, size=(160, 120), frames=40)
    write_scene_log(made, folder / "scene.mcap", style="merged")
    assert main(["replay", str(folder / "scene.mcap"), "-o", str(folder / "a.mcap")]) == 0
    return folder / "a.mcap"


@contextmanager
def served(log: Path, folder: Path, *, edit: bool) -> Iterator[DeskServer]:
    corrections, notes = folder / "c.jsonl", folder / "n.jsonl"
    with (
        Desk(log, corrections=corrections, notes=notes, edit=edit) as desk,
        DeskServer(desk) as server,
    ):
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join(10)


@pytest.fixture
def reading(log: Path, tmp_path: Path) -> Iterator[DeskServer]:
    with served(log, tmp_path, edit=False) as server:
        yield server


@pytest.fixture
def editing(log: Path, tmp_path: Path) -> Iterator[DeskServer]:
    with served(log, tmp_path, edit=True) as server:
        yield server


def ask(
    server: DeskServer, method: str, place: str, body: Any = None, **headers: str
) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    data = body if isinstance(body, bytes | None) else json.dumps(body).encode()
    try:
        named = {k.replace("_", "-"): v for k, v in headers.items()}
        connection.request(method, place, data, {**(JSON if data else {}), **named})
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


def told(server: DeskServer, what: str, body: Any) -> Any:
    return json.loads(ask(server, "POST", f"/{server.token}/{what}", body)[2])


def test_without_its_token_there_is_nothing(reading: DeskServer) -> None:
    assert reading.server_address[0] == "127.0.0.1"
    for place in (
        "/",
        "/x/",
        f"/{reading.token}",
        f"/{reading.token}x/",
        "/recording.mcap",
    ):
        status, _, data = ask(reading, "GET", place)
        assert status == 403, place
        assert reading.token not in data.decode()
    for method in ("GET", "POST"):
        place = f"/{reading.token}/" + ("" if method == "GET" else "query")
        body = None if method == "GET" else {"sql": "SELECT 1"}
        for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
            assert ask(reading, method, place, body, **headers)[0] == 403
    assert ask(reading, "GET", f"/{reading.token}/../../etc/passwd")[0] == 404
    assert ask(reading, "PUT", f"/{reading.token}/note", {})[0] == 501


def test_the_page_and_its_policy(reading: DeskServer) -> None:
    status, headers, data = ask(reading, "GET", f"/{reading.token}/")
    assert status == 200
    assert headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Cache-Control"] == "no-store"
    html = data.decode()
    found = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert found is not None
    assert "connect-src 'self'" in found[1]
    assert "unsafe" not in found[1].split("script-src")[1]
    assert reading.token not in html


def test_every_frame_has_its_picture_and_boxes(reading: DeskServer, log: Path) -> None:
    for number in (0, 17, 39):
        _, _, data = ask(reading, "GET", f"/{reading.token}/frame/{number}")
        step = json.loads(data)
        assert step["frame"] == number
        assert all(len(node) == 6 for node in step["nodes"])
        _, headers, data = ask(reading, "GET", f"/{reading.token}/picture/{number}.jpg")
        assert headers["Content-Type"] == "image/jpeg"
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert image.shape == (120, 160, 3)
    assert json.loads(ask(reading, "GET", f"/{reading.token}/frame/999")[2])["frame"] == 39
    assert ask(reading, "GET", f"/{reading.token}/picture/999.jpg")[0] == 404


@pytest.mark.parametrize(
    ("wanted", "status", "span"),
    [
        ("bytes=0-7", 206, slice(0, 8)),
        ("bytes=10-", 206, slice(10, None)),
        ("bytes=-8", 206, slice(-8, None)),
        ("", 200, slice(None)),
        ("bytes=0-1,4-5", 200, slice(None)),
        ("bytes=999999999999-", 416, slice(0, 0)),
    ],
)
def test_ranges(
    reading: DeskServer, log: Path, wanted: str, status: int, span: slice
) -> None:
    place = f"/{reading.token}/recording.mcap"
    got, headers, data = ask(reading, "GET", place, None, Range=wanted)
    whole = log.read_bytes()
    assert (got, data) == (status, whole[span])
    if status == 206:
        assert headers["Content-Range"].endswith(f"/{len(whole)}")
    assert ask(reading, "HEAD", place, None, Range=wanted)[2] == b""


def test_questions_only_read(reading: DeskServer, tmp_path: Path) -> None:
    found = told(reading, "query", {"sql": "SELECT count(*) AS n FROM frames"})
    assert found == {"columns": ["n"], "rows": [["40"]], "more": False}
    many = told(reading, "query", {"sql": "SELECT range FROM range(5000)"})
    assert (len(many["rows"]), many["more"]) == (500, True)
    for sql in (
        "DROP TABLE frames",
        f"COPY frames TO '{tmp_path / 'x.csv'}'",
        "SELECT * FROM read_csv('/etc/passwd')",
        "SELECT 1; SELECT 2",
        "--json",
        "nonsense",
        "",
    ):
        assert told(reading, "query", {"sql": sql})["error"], sql
    assert not (tmp_path / "x.csv").exists()


def test_nothing_is_written_without_edit(reading: DeskServer, tmp_path: Path) -> None:
    note = {"recording": "a", "frame": 3, "t": 0.3}
    correction = {"do": "label", "words": "1 red", "by": "Jo", "why": "seen"}
    for what, body in (("note", note), ("correct", correction)):
        status, _, data = ask(reading, "POST", f"/{reading.token}/{what}", body)
        assert status == 403
        assert "--edit" in json.loads(data)["error"]
    assert list(tmp_path.iterdir()) == []


def test_notes_and_corrections_are_written(editing: DeskServer, tmp_path: Path) -> None:
    note = {"recording": "a", "frame": 3, "t": 0.12, "text": "here", "by": "Jo"}
    assert told(editing, "note", note)["notes"][0]["text"] == "here"
    assert [n.frame for n in read_notes(tmp_path / "n.jsonl")] == [3]
    assert "is not here" in told(editing, "note", note | {"frame": 999})["error"]
    assert "not understood" in told(editing, "note", {"frame": "x"})["error"]
    asked: dict[str, Any] = {
        "date": "2026-03-01",
        "do": "label",
        "words": "1 the red coat",
        "by": "Jo",
        "why": "seen",
        "frame": 5,
    }
    made = told(editing, "correct", asked)
    assert made["told"].startswith(
        "Correction 1 is written into c.jsonl: target 1 is 'the red"
    )
    assert made["pending"] == [1]
    (row,) = read_corrections(tmp_path / "c.jsonl").rows
    assert (row.do, row.text, row.frame, row.by) == ("label", "the red coat", 5, "Jo")
    assert row.date == "2026-03-01"
    for wrong, said in (
        ({"do": "merge", "words": "1 99"}, "there is no target 99"),
        ({"do": "melt", "words": "1"}, "no correction 'melt'"),
        ({"why": " "}, "for what reason"),
        ({"do": "undo", "words": "7"}, "no such correction is in force"),
    ):
        assert said in told(editing, "correct", asked | wrong)["error"]
    assert told(editing, "correct", asked | {"do": "undo", "words": "1"})["pending"] == [
        1,
        2,
    ]


@pytest.mark.parametrize(
    ("body", "headers", "status"),
    [
        (b"{", {}, 400),
        (b"[" * 60_000, {}, 400),
        (b"{}" + b" " * 70_000, {}, 413),
        (b"{}", {"Content_Type": "text/plain"}, 415),
    ],
)
def test_bodies_that_are_none(
    editing: DeskServer, body: bytes, headers: dict[str, str], status: int
) -> None:
    assert ask(editing, "POST", f"/{editing.token}/note", body, **headers)[0] == status


def test_in_a_browser(browser: Any, editing: DeskServer, tmp_path: Path) -> None:
    browser.size(1280, 1600)
    browser.visit(editing.url)
    wait = "return document.getElementById('viewer').dataset.frame === '{}'"
    browser.wait(wait.format(0))
    browser.run(
        "const s = document.getElementById('slider'); s.value = 17; s.dispatchEvent(new Event('input'))"
    )
    browser.wait(wait.format(17))
    browser.wait("return document.getElementById('thumbnail').naturalWidth === 160")
    browser.run("document.getElementById('next').click()")
    browser.wait(wait.format(18))
    assert browser.run("return document.querySelectorAll('#overlay g').length") > 0
    browser.run(
        "document.getElementById('correct-do').value = 'label';"
        "document.getElementById('correct-words').value = '1 <b>red</b>';"
        "document.getElementById('correct-by').value = 'Jo';"
        "document.getElementById('correct-why').value = 'seen';"
        "document.getElementById('correct-form').requestSubmit()"
    )
    said = "return document.getElementById('correct-said').textContent"
    browser.wait(said + ".startsWith('Correction 1 is written')")
    assert "not replayed yet" in browser.run(
        "return document.getElementById('corrections').textContent"
    )
    assert read_corrections(tmp_path / "c.jsonl").rows[0].frame == 18
    browser.run("document.getElementById('bookmark').click()")
    browser.wait("return document.querySelectorAll('#notes li').length === 1")
    browser.run("document.getElementById('ask-form').requestSubmit()")
    browser.wait("return document.querySelectorAll('#answer th').length === 5", 60)
    assert browser.console() == []


def test_the_command_prints_where_it_is(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(log), "--port", "99999"]) == 2
    assert "must be 0 to 65535" in capsys.readouterr().err
    assert main(["view", str(log), "--recording", "b"]) == 2
    assert "is no case" in capsys.readouterr().err
