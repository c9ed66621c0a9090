"""The report in a real browser: a quiet console, a filter that filters, a slider that moves,
clicks that show.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import Struct
from msgspec.structs import replace

from recorders import channels
from recorders.errors import OutputExistsError
from recorders.log import LogWriter
from recorders.messages import (
    Detections,
    Event,
    Group,
    Groups,
    Relation,
    Relations,
    RelationState,
    Track,
    Tracks,
)
from recorders.pictures import encode_jpeg
from recorders.quality import QualityMeasure, quality_text
from replay.cli import main
from replay.report import write_report
from replay.report.data import ReportOptions

FRAME_NS = 40_000_000
FRAMES = 60
QUALITY = [
    QualityMeasure(
        "clean_sightings", 2.0, "only 2 bodies were seen clean; give <b>a detector</b>"
    ),
    QualityMeasure("noise", 0.0),
]
NASTY = '</script><script>window.stolen = 1</script><img src=x onerror="window.stolen = 1">'


def _track(i: int, n: int) -> Track:
    return Track(
        id=i, box=(20.0 + 2 * n if i == 1 else 200.0 - 2 * n, 60.0, 16.0, 40.0), ellipse=None, velocity=(50.0, 0.0),
        shell_radius=30.0, mode="motion", confidence=0.9, present=True, observed=True, blob=-1, grouping=False,
        grouped=20 <= n < 30, splitting=False, grouping_partners=[], grouped_partners=[], splitting_partners=[],
        group=1 if 20 <= n < 30 else None, scene="inside",
    )  # fmt: skip


def _messages(n: int) -> list[tuple[str, object]]:
    state: RelationState = "JOINT" if 20 <= n < 30 else "INTERACTION"
    related = (
        [Relation(1, 2, state, 10, 10 * FRAME_NS, False, state == "JOINT", False, 0.4)]
        if 10 <= n < 40
        else []
    )
    groups = [Group(1, [1, 2], True, 20, 20 * FRAME_NS)] if 20 <= n < 30 else []
    out: list[tuple[str, object]] = [
        ("detections", Detections(n, 240, 160)),
        ("tracks", Tracks(n, [_track(1, n), _track(2, n)])),
        ("relations", Relations(n, related)),
        ("groups", Groups(n, groups)),
    ]
    happened = {
        0: ("entered", [1], NASTY),
        10: ("interaction_started", [1, 2], "They meet."),
        20: ("joined", [1, 2], ""),
    }
    if n in happened:
        kind, subjects, text = happened[n]
        out.append(
            (
                "events",
                Event(n + 1, kind, subjects, n, n * FRAME_NS, "SHELLS 2.3", {}, text),
            )
        )
    return out


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "scene.mcap"
    with LogWriter(path, picture_topics=["/camera/image"]) as log:
        names = ("image", "detections", "tracks", "relations", "groups", "events")
        ids = {
            n: log.channel(
                channels.topic("camera", n),
                channels.schema(n),
                channels.message_encoding(n),
            )
            for n in names
        }
        for n in range(FRAMES):
            picture = np.full((160, 240, 3), 40 + 3 * n, np.uint8)
            log.write(
                ids["image"],
                channels.compressed_image(
                    encode_jpeg(picture), "jpeg", n * FRAME_NS, "camera"
                ),
                n * FRAME_NS,
            )
            for name, message in _messages(n):
                log.write(ids[name], channels.encode(name, message), n * FRAME_NS)
        log.metadata(
            "scenetrace.recording",
            {"camera": "camera", "quality": quality_text(QUALITY)},
        )
    return path


@pytest.fixture(scope="module")
def report(scene: Path) -> Path:
    out = scene.with_name("report.html")
    figures = write_report(scene, out)
    assert figures["targets"] == 2
    assert figures["frames"] == FRAMES
    assert figures["events"] == 3
    return out


def page_data(page: Path) -> dict[str, Any]:
    html = page.read_text(encoding="utf-8")
    pattern = r'<script type="application/json" id="data">(.*?)</script>'
    data = re.search(pattern, html, re.DOTALL)
    assert data is not None
    return json.loads(data[1])


def test_one_file_that_asks_for_nothing_else(report: Path) -> None:
    html = report.read_text(encoding="utf-8")
    page = re.sub(r"<script>.*?</script>", "", html, flags=re.DOTALL)
    assert not re.search(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//""", page)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert policy[1].startswith("default-src 'none'; img-src data: blob:;")
    scripts = policy[1].split("script-src ")[1].split(";")[0].split()
    # The two scripts by their digests, no other; what is not named may not be asked for.
    assert len(scripts) == 2
    assert all(s.startswith("'sha256-") for s in scripts)
    data = re.search(
        r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL
    )
    assert data is not None
    assert "<" not in data[1]
    assert json.loads(data[1])["events"][0][5] == NASTY


def test_the_quality_stands_above_and_among_the_facts(report: Path) -> None:
    data = page_data(report)
    assert data["warning"] == QUALITY[0].verdict
    assert ["Quality: noise", "0: good"] in data["facts"]
    assert ["Quality: clean_sightings", f"2: {QUALITY[0].verdict}"] in data["facts"]


def test_not_overwritten(report: Path, scene: Path) -> None:
    with pytest.raises(OutputExistsError):
        write_report(scene, report)


def test_command(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "r.html"
    assert main(["report", str(scene), "-o", str(out), "--thumbnails", "4"]) == 0
    assert out.stat().st_size > 1_000_000
    assert "2 targets" in capsys.readouterr().err
    assert (
        main(["report", str(scene), "-o", str(tmp_path / "q.html"), "--thumbnails", "1"])
        == 2
    )


def test_same_log_same_page(report: Path, scene: Path, tmp_path: Path) -> None:
    write_report(scene, tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == report.read_bytes()


def embedded(page: Path) -> dict:
    data = re.search(
        r'<script type="application/json" id="data">(.*?)</script>',
        page.read_text("utf-8"),
        re.DOTALL,
    )
    assert data is not None
    return json.loads(data[1])


def test_a_page_is_bounded_and_says_what_it_leaves_out(
    browser: Any, scene: Path, tmp_path: Path
) -> None:
    out = tmp_path / "short.html"
    options = ReportOptions(
        thumbnails=4, steps=5, tracks=1, all_points=6, events=2, intervals=1
    )
    write_report(scene, out, options=options)
    data = embedded(out)
    assert len(data["thumbnails"]) <= 6
    assert len(data["times"]) == 5
    shown = {frame for frame, _ in data["thumbnails"]} | {f for f, _ in data["times"]}
    assert {step["frame"] for step in data["steps"]} == shown
    assert [len(t["path"]) <= 7 for t in data["tracks"]] == [True]
    assert data["tracks"][0]["path"][-1][2] == FRAMES - 1
    assert data["relations"] == [
        [1, 2, "INTERACTION", 10, 19, 0.4, 0.76]
    ]  # the longest, of ties the first
    assert data["in_all"] == {
        "relations": 3,
        "groups": 1,
        "encounters": data["in_all"]["encounters"],
        "presence": 2,
    }
    assert len(data["events"]) == 2
    browser.size(1280, 1200)
    browser.open(out)
    assert "1 more are in the log" in browser.run(
        "return document.getElementById('count').textContent"
    )
    assert "1 longest of 2 rows of presence" in browser.run(
        "return document.getElementById('cut').textContent"
    )
    browser.run("document.querySelector('[data-view=relations]').click()")
    assert "1 longest of 3 rows of relations" in browser.run(
        "return document.getElementById('cut').textContent"
    )
    browser.run(
        "const s = document.getElementById('search'); s.value = 'zebra';"
        " s.dispatchEvent(new Event('input'))"
    )
    assert "No event fits" in browser.run(
        "return document.querySelector('#events tbody').textContent"
    )
    assert browser.console() == []


def test_hours_are_told_as_hours(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    with LogWriter(path) as log:
        names = ("detections", "tracks", "relations", "groups", "events")
        ids = {
            n: log.channel(
                channels.topic("camera", n),
                channels.schema(n),
                channels.message_encoding(n),
            )
            for n in names
        }
        start = 1_700_000_000_000_000_000
        for n in range(FRAMES):  # a frame in two minutes
            for name, message in _messages(n):
                log.write(
                    ids[name], channels.encode(name, message), start + n * 120_000_000_000
                )
    out = tmp_path / "long.html"
    assert write_report(path, out)["length"] == "1 h 58 min"
    assert ["Began", "2023-11-14 22:13:20 UTC"] in embedded(out)["facts"]
    browser.size(400, 1200)
    browser.open(out)
    browser.wait("return document.querySelectorAll('#timeline .bars path').length > 0")
    assert (
        browser.run("return document.querySelector('#timeline .xtick text').textContent")
        == "0:00:00"
    )
    browser.run(
        "const s = document.getElementById('slider'); s.value = 45; s.dispatchEvent(new"
        " Event('input'))"
    )
    assert (
        browser.run("return document.getElementById('moment').textContent")
        == "1:30:00, frame 45"
    )
    assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
    assert browser.console() == []


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (400, True)])
def test_in_a_browser(
    browser: Any, report: Path, tmp_path: Path, width: int, dark: bool
) -> None:
    browser.size(width, 1600, dark=dark)
    browser.open(report)
    browser.wait("return document.querySelectorAll('#timeline .bars path').length > 0")
    assert browser.run("return document.documentElement.dataset.theme") == (
        "dark" if dark else "light"
    )
    assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
    assert browser.run("return window.stolen") is None
    warning = "return document.getElementById('warning')."
    assert browser.run(warning + "innerText") == QUALITY[0].verdict

    rows = "return document.querySelectorAll('#events tbody tr').length"
    assert browser.run(rows) == 3
    browser.run(
        "const s = document.getElementById('search'); s.value = 'meet'; s.dispatchEvent(new"
        " Event('input'))"
    )
    assert browser.run(rows) == 1
    browser.run(
        "const s = document.getElementById('search'); s.value = ''; s.dispatchEvent(new"
        " Event('input'))"
    )
    browser.run(
        "const k = document.getElementById('kind'); k.value = 'joined'; k.dispatchEvent(new"
        " Event('change'))"
    )
    assert browser.run(rows) == 1
    browser.run("document.querySelector('#events tbody tr').click()")
    assert browser.run("return document.getElementById('viewer').dataset.frame") == "20"
    assert browser.run("return document.getElementById('thumbnail').naturalWidth") > 100

    browser.run(
        "const s = document.getElementById('slider'); s.value = 12; s.dispatchEvent(new"
        " Event('input'))"
    )
    assert browser.run("return document.getElementById('graph').dataset.frame") == "12"
    assert "0.48 s" in browser.run("return document.getElementById('moment').textContent")

    browser.run("document.getElementById('next').click()")
    assert browser.run("return document.getElementById('viewer').dataset.frame") == "13"
    browser.run("document.querySelector('[data-view=relations]').click()")
    browser.wait(
        "return document.querySelector('#timeline .legend')?.textContent.includes('JOINT')"
    )
    browser.run("document.getElementById('timeline').scrollIntoView()")
    x, y = browser.run(
        "const r = document.querySelector('#timeline .trace:nth-child(2) .point"
        " path').getBoundingClientRect();return [r.x + r.width / 2, r.y + r.height / 2]"
    )
    browser.click_at(x, y)
    browser.wait("return document.getElementById('viewer').dataset.frame === '20'")

    picture = tmp_path / "page.png"
    browser.picture(picture)
    assert picture.stat().st_size > 10_000
    browser.run("document.getElementById('theme').click()")
    assert browser.run("return document.documentElement.dataset.theme") == (
        "light" if dark else "dark"
    )
    assert browser.console() == []


def test_the_desk(browser: Any, scene: Path, tmp_path: Path) -> None:
    """It plays, singles a target out, says where a picture is not the moment's own, keeps notes."""
    out = tmp_path / "desk.html"
    # Few pictures, so that most moments have none.
    write_report(scene, out, options=ReportOptions(thumbnails=6, steps=12))
    browser.size(1280, 1600)
    browser.open(out)
    text = "return document.getElementById({!r}).textContent"
    move = "const s = document.getElementById('slider'); s.value = {}; s.dispatchEvent(new Event('input'))"  # fmt: skip
    pictures = [frame for frame, _ in page_data(out)["thumbnails"]]
    missing = next(f for f in range(FRAMES) if f not in pictures)
    browser.run(move.format(missing))
    said = browser.run(text.format("caption"))
    assert f"the nearest picture to frame {missing}, which has none here" in said
    assert browser.run(text.format("moment")).endswith(f"frame {missing}")
    browser.run(move.format(pictures[1]))
    assert "nearest" not in browser.run(text.format("caption"))
    # The cursor stands at the moment, in the timeline.
    left = "return document.getElementById('cursor').getBoundingClientRect().left"
    there = browser.run(left)
    browser.run(move.format(FRAMES - 1))
    assert browser.run(left) > there + 100
    # Boxes, and one of them singled out by a click.
    boxes = "return document.querySelectorAll('#overlay g{}').length"
    assert browser.run(boxes.format("")) == 2
    browser.run("document.querySelector('#overlay g').dispatchEvent(new Event('click', {bubbles: true}))")  # fmt: skip
    assert browser.run("return document.getElementById('single').value") == "1"
    assert browser.run(boxes.format(".aside")) == 1
    assert browser.run("return document.querySelectorAll('#timeline .ytick').length") == 1
    # Played to the end it stops by itself.
    browser.run("document.getElementById('speed').value = '16'")
    browser.run(move.format(0) + "; document.getElementById('play').click()")
    assert browser.run(text.format("play")) == "pause"
    browser.wait("return document.getElementById('play').textContent === 'play'")
    assert browser.run("return document.getElementById('slider').value") == str(FRAMES - 1)
    # Keys.
    press = "document.body.dispatchEvent(new KeyboardEvent('keydown', {{key: {!r}, bubbles: true}}))"  # fmt: skip
    browser.run(press.format("ArrowLeft"))
    assert (
        int(browser.run("return document.getElementById('slider').value")) == pictures[-2]
    )
    browser.run(press.format("b"))
    browser.run(
        "document.getElementById('note-text').value = arguments[0];"
        " document.getElementById('note-form').requestSubmit()",
        NASTY,
    )
    notes = "return [...document.querySelectorAll('#notes li')].map((n) => n.textContent)"
    assert [NASTY in note for note in browser.run(notes)] == [False, True]
    browser.open(out)
    assert len(browser.run(notes)) == 2
    assert browser.run("return window.stolen") is None
    assert browser.console() == []


def test_brief_by_default(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "brief.mcap"
    with LogWriter(path) as log:
        for n in range(FRAMES):
            messages = _messages(n)
            if n == 5:
                event = Event(90, "track_lost", [1], n, n * FRAME_NS, "ours", {}, "gone")
                messages.append(("events", event))
            for name, message in messages:
                channel = log.channel(
                    f"/camera/{name}",
                    channels.schema(name),
                    channels.message_encoding(name),
                )
                log.write(channel, channels.encode(name, message), n * FRAME_NS)
    out = tmp_path / "brief.html"
    write_report(path, out)
    browser.size(1280, 1600)
    browser.open(out)
    rows = "return document.querySelectorAll('#events tbody tr').length"
    assert browser.run(rows) == 3
    count = browser.run("return document.getElementById('count').textContent")
    assert count == "3 of 4 events; 1 that trackers say of themselves are not shown"
    browser.run("document.getElementById('all').click()")
    assert browser.run(rows) == 4
    assert "this log holds no pictures" in browser.run(
        "return document.getElementById('caption').textContent"
    )


def test_ten_minutes_stay_small(tmp_path: Path) -> None:
    path = tmp_path / "ten.mcap"
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 255, (300, 400, 3), np.uint8)
    pictures = [encode_jpeg(np.roll(noise, n, axis=1)) for n in range(20)]
    with LogWriter(path, picture_topics=["/camera/image"]) as log:
        for n in range(300):
            stamp = n * 2_000_000_000
            picture = pictures[n % len(pictures)]
            image = channels.compressed_image(picture, "jpeg", stamp, "camera")
            named = [("image", image)]
            for name, message in _messages(n % FRAMES):
                if name != "events":
                    size = {"width": 400, "height": 300} if name == "detections" else {}
                    assert isinstance(message, Struct)
                    now = replace(message, frame=n, **size)
                    named.append((name, channels.encode(name, now)))
            for name, data in named:
                channel = log.channel(
                    f"/camera/{name}",
                    channels.schema(name),
                    channels.message_encoding(name),
                )
                log.write(channel, data, stamp)
    out = tmp_path / "ten.html"
    write_report(path, out)
    # Noise is the worst that a picture can be.
    assert out.stat().st_size < 15_000_000
    assert len(page_data(out)["thumbnails"]) > 50


def test_a_span_is_told_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "span.mcap"
    with LogWriter(path) as log:
        for n in range(40, FRAMES):
            for name, message in _messages(n):
                channel = log.channel(
                    f"/camera/{name}",
                    channels.schema(name),
                    channels.message_encoding(name),
                )
                log.write(channel, channels.encode(name, message), n * FRAME_NS)
    out = tmp_path / "span.html"
    assert main(["report", str(path), "-o", str(out)]) == 0
    assert "0.8 s length, 20 frames" in capsys.readouterr().err
    told = page_data(out)  # of which nothing was measured
    assert told["warning"] == ""
    assert not [name for name, _ in told["facts"] if name.startswith("Quality")]
