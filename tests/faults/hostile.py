"""Each command that reads, on each hostile file, under a limit of memory and of time: read or refused,
in words; nothing half is left; what is said to be sound is.
"""

from __future__ import annotations

import os
import resource
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

from tests.faults.case_files import case_files
from tests.faults.damage import messages_of
from tests.faults.io_faults import counted, files_of, forked, warm
from tests.faults.small import annotated, memory, run
from tests.faults.tally import Tally
from tests.lying_files import mcap_bomb, png

_MEMORY = 2 << 30
_SECONDS = 60  # of the processor: the machine may be busy
_PATIENCE_S = 600.0
_COMPARED_BYTES = 50 << 20

LOGS: dict[str, str] = {
    "info": "info FILE",
    "doctor": "doctor FILE",
    "recover": "recover FILE -o OUT.mcap",
    "replay": "replay FILE -o OUT.mcap",
    "verify": "verify FILE",
    "diff": "diff FILE ../sound.mcap",
    "diff, turned round": "diff ../sound.mcap FILE",
    "query": "query FILE SQL",
    "query --ask": "query FILE --ask met 1",
    "find": "find FILE --color red",
    "explain": "explain FILE event:1",
    "report": "report FILE -o OUT.html",
    "evidence": "evidence FILE --events 1 -o OUT",
    "index": "index FILE -o OUT.duckdb",
    "export mot": "export FILE --to mot -o OUT.txt",
    "export csv": "export FILE --to csv -o OUT",
    "export graphml": "export FILE --to graphml -o OUT.graphml",
    "export video": "export FILE --to video -o OUT.mp4",
    "eval": "eval FILE --truth ../det.txt",
    "cut": "cut FILE --from 0.1 --to 0.3 -o OUT.mcap",
    "filter": "filter FILE --topics /camera/detections -o OUT.mcap",
    "merge": "merge FILE ../sound.mcap -o OUT.mcap",
    "sort": "sort FILE -o OUT.mcap",
    "record": "record FILE -o OUT.mcap",
    "seal": "seal FILE -o OUT.json",
}
_REWRITING = ("recover", "replay", "cut", "filter", "merge", "sort", "record", "seal")
OTHERS: dict[str, str] = {
    "record": "record FILE -o OUT.mcap --fps 25",
    "record beside pictures": "record ../pictures --detections FILE --fps 25 -o OUT.mcap",
    "eval": "eval ../sound.mcap --truth FILE",
    "replay --regions": "replay ../scene.mcap --regions FILE -o OUT.mcap",
    "replay --config": "replay ../scene.mcap --config FILE -o OUT.mcap",
    "info": "info FILE",
    "doctor": "doctor FILE",
    "recover": "recover FILE -o OUT.mcap",
    "query": "query FILE SQL",
    "verify": "verify FILE",
    "seal": "seal FILE -o OUT.json",
}
_KEEPING = ("record", "index")
"""What they leave is for `recover`, or is gone on with."""


def _xml_bomb() -> bytes:
    levels = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
    return f'<!DOCTYPE x [<!ENTITY a0 "ha">{levels}]><dataset>&a9;</dataset>'.encode()


BOMBS: dict[str, Callable[[], bytes]] = {
    "pictures/1.png": lambda: png(60000, 60000),
    "entities.xml": _xml_bomb,
    "unpacks-to-a-gigabyte.mcap": lambda: mcap_bomb(1 << 30, 1 << 30),
    "unpacks-to-more-than-it-says.mcap": lambda: mcap_bomb(64 << 20, 100),
    "deep.json": lambda: b"[" * 100_000 + b"]" * 100_000,
    "deep.toml": lambda: b"a = " + b"[" * 100_000 + b"]" * 100_000,
    "keys.toml": lambda: b".".join([b"a"] * 100_000) + b" = 1\n",
    "digits.json": lambda: b'{"frame": ' + b"9" * 1_000_000 + b"}",
    "line.txt": lambda: b"1," * 100_000_000,
    "lines.txt": lambda: b"1,1,1,1,9,9,1\n" * 100_000,
    "empty.mcap": lambda: b"",
    "zeros.mcap": lambda: bytes(1 << 20),
}


def hostile(long: bool, seed: int = 0, only: str = "") -> Iterator[Tally]:
    """Bombs, damaged logs, the files that people reported: a row for each sort (whose name
    begins so). Counted in a process of its own, in which nothing has taken memory before.
    """
    return counted("tests.faults.hostile:all_hostile", long, seed, 0, only, {})


def all_hostile(long: bool, seed: int, tries: int, only: str) -> Iterator[Tally]:
    """Go through all of it, in the process that the others are forked from."""
    del tries
    sorts: dict[str, Callable[[Path], Iterator[Path]]] = {"bombs": _bombs}
    if long:
        sorts |= {
            "damaged logs": lambda folder: _damaged(folder, Random(seed)),
            "reported files": case_files,
        }
    with tempfile.TemporaryDirectory(dir=memory()) as name:
        folder = Path(name).resolve()
        annotated(folder).rename(folder / "sound.mcap")
        (folder / "pictures").mkdir()
        (folder / "pictures" / "1.png").write_bytes(png(8, 8))
        fresh = _address_space()
        if long:
            # What commands load and keep, the processes that are forked have then.
            for words in LOGS.values():
                named = {"FILE": "../sound.mcap", "SQL": "SELECT 1"}
                warm([named.get(word, word) for word in words.split()], folder)
        for sort, files in sorts.items():
            if sort.startswith(only):
                yield from _sort(sort, files(folder / "files"), folder, fresh, long)


def _bombs(folder: Path) -> Iterator[Path]:
    for name, make in BOMBS.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(make())
        yield path.parent if path.parent.name == "pictures" else path


def _damaged(folder: Path, rng: Random) -> Iterator[Path]:
    """The annotated log and the scene, with what some records say they are, where they end and
    what is in their middle changed; with bits flipped; cut; with zeros or more at the end.
    """
    folder.mkdir(exist_ok=True)
    for name in ("sound.mcap", "scene.mcap"):
        data = (folder.parent / name).read_bytes()
        places, at = [], 8
        while at < len(data) - 8:
            (size,) = struct.unpack_from("<Q", data, at + 1)
            places += [at, at + 1, at + 9 + size // 2]
            at += 9 + size
        places = rng.sample(places, min(25, len(places)))
        places += [rng.randrange(len(data)) for _ in range(10)]
        damaged = [data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :] for at in places]
        damaged += [data[: rng.randrange(len(data))] for _ in range(5)]
        half = data[: len(data) // 2]
        damaged += [half + bytes(5000), data + data, data + b"more", half + data, data[8:]]
        for number, changed in enumerate(damaged):
            path = folder / f"{number}-{name}"
            path.write_bytes(changed)
            yield path
            path.unlink()


def _sort(
    sort: str, files: Iterator[Path], folder: Path, fresh: int, long: bool
) -> Iterator[Tally]:
    """A row for each file."""
    replayed = folder / "replayed.mcap"
    for file in files:
        tally = Tally(f"{sort}: {file.name}")
        commands = LOGS if file.suffix == ".mcap" else OTHERS
        if not long:
            commands = {name: commands[name] for name in ("record", "info", "query")}
        _through(tally, commands, _File(file, folder, fresh, replayed, file.name))
        if replayed.exists():
            # What was read without a word must be of use afterwards.
            answering = {name: LOGS[name] for name in LOGS if name not in _REWRITING}
            name = f"{file.name}, replayed"
            _through(tally, answering, _File(replayed, folder, fresh, None, name))
            replayed.unlink()
        yield tally


def _through(tally: Tally, commands: dict[str, str], told: _File) -> None:
    for command, words in commands.items():
        told.try_(tally, command, words)
    if os.environ.get("SCENETRACE_TOLD"):
        print(told.name, told.codes, file=sys.stderr, flush=True)


class _File:
    """What commands make of one file; ``codes`` are their exit codes, and what `replay` makes of
    it is kept as ``replayed``.
    """

    def __init__(
        self, path: Path, folder: Path, fresh: int, replayed: Path | None, name: str
    ) -> None:
        self.path, self.folder, self.fresh = path, folder, fresh
        self.replayed, self.name = replayed, name
        self.codes: dict[str, int] = {}

    def try_(self, tally: Tally, command: str, words: str) -> None:
        """Count what one of them made of it."""
        named = {"FILE": str(self.path), "SQL": "SELECT * FROM tracks"}
        line = [named.get(word, word) for word in words.split()]
        with tempfile.TemporaryDirectory(dir=self.folder) as name:
            place = Path(name)
            answer, said = forked(place, lambda _: _held(line, self.fresh), _PATIENCE_S)
            tally.tries += 1
            code, told = answer or (70, said or f"killed, or took over {_SECONDS} s")
            self.codes[command] = code
            wrong = f"{self.name}: `{command}`: exit {code}: "
            if answer is None and not said:
                tally.lost += 1
                tally.note(wrong + told)
            elif code not in (0, 1, 2, 3, 4) or "Traceback" in told:
                tally.foreign += 1
                tally.note(wrong + told[-300:])
            elif code in (1, 2) and not command.startswith(_KEEPING) and files_of(place):
                tally.lost += 1
                tally.note(f"{wrong}left {sorted(files_of(place))}")
            elif silent := self._silent(command, code, told, place):
                tally.silent += 1
                tally.note(wrong + silent)
            else:
                tally.survived += 1
            if command == "replay" and code in (0, 3) and self.replayed is not None:
                (place / "OUT.mcap").rename(self.replayed)

    def _silent(self, command: str, code: int, told: str, place: Path) -> str:
        """What is wrong and was not said."""
        if code in (1, 2) and not told.strip() and command not in ("doctor", "verify"):
            return "not a word"
        if command == "replay" and code == 0:
            again, _ = forked(place, lambda _: run("verify", "OUT.mcap"))
            if again is None or again[0] not in (0, 3):
                return f"what it wrote does not verify: {again}"
        small = self.path.stat().st_size < _COMPARED_BYTES
        if command == "recover" and code == 0 and small and self.codes.get("doctor") == 0:
            whole = messages_of(self.path) == messages_of(place / "OUT.mcap")
            return "" if whole else "the log is sound, and messages were lost"
        return ""


def _held(words: list[str], fresh: int) -> tuple[int, str]:
    # What this process has taken since it was fresh, it took for all: to be warm, and to compare. A
    # thread that gets no memory never starts, and is waited for.
    most = _MEMORY + _address_space() - fresh
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
    return run(*words)


def _address_space() -> int:
    """Bytes of it that this process has."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * resource.getpagesize()
