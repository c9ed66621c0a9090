"""A case's manifest: what was altered or is missing is named, whoever signed it."""

from __future__ import annotations

import builtins
import json
import os
import stat
from pathlib import Path
from typing import Any

import msgspec
import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders.errors import RecordingError, UsageError
from replay.annotated_writer import replay
from replay.cli import main
from replay.run import ReplayOptions
from replay.sealing import check_manifest, new_key, read_manifest, seal, sign
from replay.sealing.manifest import added_files, write_manifest


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    write_scene_log(generate("pass_by", size=(96, 72), frames=12), folder / "scene.mcap")
    replay(folder / "scene.mcap", folder / "annotated.mcap", ReplayOptions())
    return folder


@pytest.fixture
def case(logs: Path, tmp_path: Path) -> Path:
    for name in ("scene.mcap", "annotated.mcap"):
        (tmp_path / name).write_bytes((logs / name).read_bytes())
    (tmp_path / "answers").mkdir()
    (tmp_path / "answers" / "who.csv").write_text("a,b\n1,2\n")
    return tmp_path


FILES = ["annotated.mcap", "answers/who.csv", "scene.mcap"]


def sealed(case: Path, **more: Any) -> Path:
    out = case / "case.json"
    given = [case / "scene.mcap", case / "annotated.mcap", case / "answers"]
    write_manifest(seal(given, out, **more), out, force=True)
    return out


def test_an_untouched_case_is_intact(case: Path) -> None:
    manifest = read_manifest(sealed(case, note="hall, camera 2"))
    assert [(e.name, e.role) for e in manifest.files] == list(
        zip(FILES, ["annotated", "file", "scene"], strict=True)
    )
    assert manifest.files[0].facts["tracker"] == "events"
    assert len(manifest.files[0].facts["output_digest"]) == 64
    verdict = check_manifest(case / "case.json")
    assert verdict.intact
    assert (verdict.signature, verdict.note) == ("none", "hall, camera 2")


def test_the_manifest_is_the_same_for_the_same_files(case: Path) -> None:
    first = sealed(case).read_bytes()
    (case / "case.json").unlink()
    assert sealed(case).read_bytes() == first
    assert first == json.dumps(json.loads(first), indent=2, sort_keys=True).encode() + b"\n"


@pytest.mark.parametrize("name", FILES)
def test_one_bit_in_any_file_is_named(case: Path, name: str) -> None:
    sealed(case)
    data = bytearray((case / name).read_bytes())
    data[len(data) // 2] ^= 1
    (case / name).write_bytes(data)
    verdict = check_manifest(case / "case.json")
    assert not verdict.intact
    assert [(f.name, f.state) for f in verdict.files if f.state != "unaltered"] == [
        (name, "altered")
    ]
    assert "SHA-256 was" in verdict.lines()[0]


def test_what_is_missing_or_not_a_file_is_named(case: Path) -> None:
    sealed(case)
    (case / "scene.mcap").unlink()
    (case / "annotated.mcap").unlink()
    os.mkfifo(case / "annotated.mcap")
    states = {f.name: f.state for f in check_manifest(case / "case.json").files}
    assert states == {
        "scene.mcap": "missing",
        "annotated.mcap": "unreadable",
        "answers/who.csv": "unaltered",
    }


def test_a_source_is_known_by_the_digest_in_its_scene_log(tmp_path: Path) -> None:
    source = tmp_path / "det.txt"
    source.write_text(
        "".join(f"{k},-1,{10 + k},20,10,20,1,-1,-1,-1\n" for k in range(1, 8))
    )
    assert (
        main(
            [
                "record",
                str(source),
                "-o",
                str(tmp_path / "scene.mcap"),
                "--size",
                "64x48",
                "--fps",
                "5",
            ]
        )
        == 0
    )
    manifest = seal([source, tmp_path / "scene.mcap"], tmp_path / "case.json")
    assert [(e.name, e.role) for e in manifest.files] == [
        ("det.txt", "source"),
        ("scene.mcap", "scene"),
    ]


def test_signed(case: Path) -> None:
    pytest.importorskip("cryptography")
    out = sealed(case)
    public = new_key(case / "lab.key")
    assert stat.S_IMODE((case / "lab.key").stat().st_mode) == 0o600
    write_manifest(sign(read_manifest(out), case / "lab.key"), out, force=True)
    assert check_manifest(out, key=public).intact
    assert check_manifest(out).signature == "valid"
    other = new_key(case / "other.key")
    assert check_manifest(out, key=other).signature == "other key"
    assert not check_manifest(out, key=other).intact

    forged = json.loads(out.read_bytes())
    (case / "answers" / "who.csv").write_text("a,b\n1,3\n")
    forged["files"][1] = json.loads(seal([case / "answers"], out).encode())["files"][0]
    out.write_text(json.dumps(forged))
    verdict = check_manifest(out, key=public)
    assert [f.state for f in verdict.files] == ["unaltered"] * 3
    assert (verdict.signature, verdict.intact) == ("invalid", False)
    del forged["signature"]
    out.write_text(json.dumps(forged))
    assert not check_manifest(out, key=public).intact, (
        "a signature that was taken away must be missed"
    )


def test_keys_are_never_overwritten_and_must_be_keys(case: Path) -> None:
    pytest.importorskip("cryptography")
    new_key(case / "lab.key")
    with pytest.raises(
        RecordingError, match="a key is never overwritten; give another name"
    ) as e:
        new_key(case / "lab.key")
    assert "--force" not in str(e.value), "there is no such way"
    manifest = seal([case / "answers"], case / "case.json")
    for wrong in (case / "lab.key.pub", case / "scene.mcap"):
        with pytest.raises(UsageError, match="must be a private Ed25519 key"):
            sign(manifest, wrong)
    write_manifest(manifest, case / "case.json")
    with pytest.raises(UsageError, match="must be a public Ed25519 key"):
        check_manifest(case / "case.json", key=case / "lab.key")


def test_without_the_library_it_says_what_to_install(
    case: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cryptography")
    out = sealed(case)
    public = new_key(case / "lab.key")
    write_manifest(sign(read_manifest(out), case / "lab.key"), out, force=True)
    real = builtins.__import__

    def without(name: str, *args: Any, **more: Any) -> Any:
        if name.startswith("cryptography"):
            raise ImportError(name)
        return real(name, *args, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UsageError, match=r"scenetrace\[sign\]"):
        check_manifest(out, key=public)
    verdict = check_manifest(out)
    assert (verdict.intact, verdict.signature) == (True, "unchecked")


@pytest.mark.parametrize(
    "text",
    [
        b"", b"{}", b"[1]", b"\xff\xfe", b"[" * 100_000,
        b'{"format":"scenetrace manifest","version":2,"files":[]}',
        b'{"format":"scenetrace manifest","version":1,"files":[{"name":"a","role":"file","bytes":1,"sha256":"x"}]}',
        b'{"format":"scenetrace manifest","version":1,"files":[],"more":1}',
    ],
)  # fmt: skip
def test_what_is_no_manifest(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "case.json").write_bytes(text)
    with pytest.raises(RecordingError, match="not a manifest"):
        check_manifest(tmp_path / "case.json")


def test_a_name_twice(case: Path) -> None:
    plain = json.loads(sealed(case).read_bytes())
    plain["files"].append(plain["files"][0])
    (case / "case.json").write_text(json.dumps(plain))
    with pytest.raises(RecordingError, match="twice"):
        read_manifest(case / "case.json")


def test_the_commands(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("cryptography")
    out, key = str(case / "case.json"), str(case / "lab.key")
    files = [str(case / name) for name in ("scene.mcap", "annotated.mcap", "answers")]
    assert main(["seal", "--new-key", key]) == 0
    assert main(["seal", *files, "-o", out, "--key", key]) == 0
    said = capsys.readouterr()
    assert said.out.count("\n") == 3
    assert "private key" not in said.err.splitlines()[-1]
    assert main(["seal", str(case), "-o", str(case / "all.json")]) == 0
    assert (
        "lab.key: is a private key: whoever gets the case can sign in its owner's name"
        in capsys.readouterr().err
    )
    assert main(["verify", "--manifest", out, "--public-key", key + ".pub"]) == 0
    assert "3 of 3 files are as they were sealed" in capsys.readouterr().out
    assert main(["verify", str(case / "annotated.mcap"), "--manifest", out]) == 0
    capsys.readouterr()
    assert main(["verify", str(case / "annotated.mcap"), "--manifest", out, "--json"]) == 0
    both = json.loads(capsys.readouterr().out)
    assert both["manifest"]["intact"]
    assert both["log"]["identical"]
    assert main(["seal", *files, "-o", out]) == 1
    assert main(["seal", str(case / "nothing"), "-o", str(case / "b.json")]) == 2
    assert main(["seal"]) == 2
    assert main(["seal", out, "-o", out, "--force"]) == 2
    (case / "answers" / "who.csv").write_text("")
    assert main(["verify", "--manifest", out]) == 4
    assert "altered: answers/who.csv (8 bytes, now 0" in capsys.readouterr().out
    assert main(["verify"]) == 2
    assert main(["verify", files[1], "--public-key", key]) == 2
    (case / "scene.mcap").write_bytes((case / "scene.mcap").read_bytes()[:-30])
    assert main(["seal", str(case / "scene.mcap"), "-o", str(case / "b.json")]) == 1
    assert "a damaged log is not sealed" in capsys.readouterr().err


def test_a_manifest_leads_into_no_folder_of_which_it_lists_nothing(tmp_path: Path) -> None:
    mine, theirs = tmp_path / "case", tmp_path / "theirs"
    for folder in (mine, theirs):
        folder.mkdir()
        (folder / "a.txt").write_text("a")
    manifest = mine / "manifest.json"
    case_manifest = seal([mine], manifest)
    assert case_manifest.folders == ["."]
    write_manifest(case_manifest, manifest)
    assert added_files(case_manifest, manifest) == []
    (mine / "b.txt").write_text("b")
    assert added_files(case_manifest, manifest) == ["b.txt"]
    led_astray = msgspec.structs.replace(
        case_manifest, folders=["../theirs", str(theirs), "/proc/self/task", "x" * 400]
    )
    assert added_files(led_astray, manifest) == []


def test_of_a_folder_that_has_grown_without_end_some_files_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.txt").write_text("a")
    case_manifest = seal([tmp_path], tmp_path / "manifest.json")
    for k in range(50):
        (tmp_path / f"{k}.txt").write_text("more")
    monkeypatch.setattr("replay.sealing.manifest.MOST_ADDED", 10)
    assert 0 < len(added_files(case_manifest, tmp_path / "manifest.json")) <= 12


def checked(manifest: Path) -> dict[str, str]:
    """What `verify --manifest` finds that is not as it was sealed, by name."""
    return {
        f.name: f.state for f in check_manifest(manifest).files if f.state != "unaltered"
    }


def test_a_link_to_a_file_is_sealed_under_its_own_name(tmp_path: Path) -> None:
    case, store = tmp_path / "case", tmp_path / "store"
    for folder in (case / "raw", store):
        folder.mkdir(parents=True)
    (store / "video.avi").write_text("pictures")
    (case / "answer.csv").write_text("a,b")
    (case / "raw" / "video.avi").symlink_to(store / "video.avi")
    (case / "same.csv").symlink_to("answer.csv")
    out = case / "m.json"
    assert main(["seal", str(case), "-o", str(out)]) == 0
    names = ["answer.csv", "raw/video.avi", "same.csv"]
    assert [e.name for e in read_manifest(out).files] == names
    assert check_manifest(out).intact
    (store / "video.avi").write_text("others")
    assert checked(out) == {"raw/video.avi": "altered"}
    (store / "video.avi").unlink()
    assert checked(out) == {"raw/video.avi": "missing"}
    # Named by a folder that is a link, the case is the same.
    (tmp_path / "way").symlink_to(case)
    (case / "raw" / "video.avi").unlink()
    again = seal([tmp_path / "way"], case / "n.json")
    assert ([e.name for e in again.files], again.folders) == (
        ["answer.csv", "same.csv"],
        ["."],
    )


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("folder", "a link to a folder"),
        ("nothing", "a link to nothing"),
        ("pipe", "not a regular file"),
    ],
)
def test_what_cannot_be_sealed_is_not_left_out_unsaid(
    tmp_path: Path, kind: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    case, store = tmp_path / "case", tmp_path / "store"
    for folder in (case / "sub", store):
        folder.mkdir(parents=True)
    (store / "b.txt").write_text("b")
    (case / "a.txt").write_text("a")
    at, out = case / "sub" / "more", case / "m.json"
    write_manifest(seal([case], out), out)
    if kind == "pipe":
        os.mkfifo(at)
    else:
        at.symlink_to(store if kind == "folder" else tmp_path / "nowhere")
    assert checked(out) == {"sub/more": "added"}
    assert main(["seal", str(case), "-o", str(case / "n.json")]) in (1, 2)
    err = capsys.readouterr().err
    assert str(at) in err
    assert said in err
    assert not (case / "n.json").exists()


def test_a_folder_can_be_sealed_again_and_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.txt").write_text("a")
    first, second = tmp_path / "m.json", tmp_path / "m2.json"
    assert main(["seal", str(tmp_path), "-o", str(first)]) == 0
    before = first.read_bytes()
    assert main(["seal", str(tmp_path), "-o", str(first), "--force"]) == 0
    assert first.read_bytes() == before
    capsys.readouterr()
    assert main(["seal", str(tmp_path), "-o", str(second), "--note", "two"]) == 0
    assert "m.json: another manifest, not sealed with the folder" in capsys.readouterr().err
    assert [e.name for e in read_manifest(second).files] == ["a.txt"]
    assert check_manifest(first).intact
    assert check_manifest(second).intact
    assert main(["seal", str(tmp_path), str(first), "-o", str(second), "--force"]) == 0
    assert [e.name for e in read_manifest(second).files] == [
        "a.txt",
        "m.json",
    ], "named, it is sealed"
    assert check_manifest(first).intact
    first.write_bytes(first.read_bytes().replace(b"{", b"{ ", 1))
    assert checked(second) == {"m.json": "altered"}
    (tmp_path / "more.json").write_text('{"format": "scenetrace manifest"}')
    assert checked(first) == {"more.json": "added"}, "only a whole manifest is one"
    (tmp_path / "more.json").unlink()
    # A manifest further down belongs to what is sealed: the one of evidence, say.
    (tmp_path / "evidence").mkdir()
    (tmp_path / "evidence" / "manifest.json").write_bytes(before)
    assert checked(first) == {"evidence/manifest.json": "added"}
    assert main(["seal", str(tmp_path), "-o", str(first), "--force"]) == 0
    assert "evidence/manifest.json" in [e.name for e in read_manifest(first).files]
    (tmp_path / "alias.json").symlink_to(first)
    assert main(["seal", str(tmp_path), "-o", str(first), "--force"]) == 2
    assert "alias.json: the manifest cannot seal itself" in capsys.readouterr().err
