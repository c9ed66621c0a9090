"""Check a manifest against the files: what was altered, what is missing, whose signature it
bears.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from recorders.annotated.chain import short_digests
from recorders.errors import SceneTraceError
from replay.sealing.manifest import Entry, added_files, file_digest, read_manifest
from replay.sealing.signing import public_key, signature_holds


@dataclass(frozen=True)
class SealFinding:
    """One file, or the signature: how it is, and in words where it is not as sealed."""

    name: str
    state: Literal["unaltered", "altered", "missing", "unreadable", "added"]
    text: str = ""


@dataclass(frozen=True)
class CaseVerdict:
    """The verdict on a case.

    Attributes:
        intact: every file is as it was sealed, none was added to a folder that was sealed as a
            whole, and the signature, where one was asked for or is there, holds.
        files: by name.
        signature: ``valid``, ``invalid``, ``none``, ``other key``, or ``unchecked`` (no library
            to check it with).
        key: the signer's public key in hexadecimal, empty without.
        note: the sealed note.
        sealed: by whom, when and with what it says that it was sealed; empty where it does not.
    """

    intact: bool
    files: list[SealFinding]
    signature: str
    key: str = ""
    note: str = ""
    sealed: str = ""

    def lines(self) -> list[str]:
        """The verdict for a person."""
        bad = [file for file in self.files if file.state != "unaltered"]
        out = [f"{f.state}: {f.name}" + (f" ({f.text})" if f.text else "") for f in bad]
        sealed = sum(file.state != "added" for file in self.files)
        out.append(
            f"{len(self.files) - len(bad)} of {sealed} files are as they were sealed"
        )
        said = {
            "none": "not signed: whoever can write the files can write the manifest, too",
            "valid": f"signed with the key {self.key}",
            "invalid": "the signature does not hold: the manifest was altered after it was signed",
            "other key": f"signed with another key than the one given: {self.key}",
            "unchecked": "signed, but not checked: pip install 'scenetrace[sign]'",
        }
        out.append(said[self.signature])
        out += [f"sealed: {self.sealed}"] if self.sealed else []
        return out + ([f"note: {self.note}"] if self.note else [])


def check_manifest(
    path: str | Path,
    *,
    key: str | Path | None = None,
    progress: Callable[[str, int], None] | None = None,
) -> CaseVerdict:
    """Check every file of a manifest, and its signature.

    Args:
        path: the manifest; its files are looked for relative to its folder.
        key: the public key that must have signed it.
        progress: called with a stage's name and the number of files done.

    Raises:
        RecordingError: not a manifest.
        UsageError: ``key`` is no public key, or it was given and the package ``cryptography`` is
            not installed.
    """
    manifest = read_manifest(path)
    wanted = None if key is None else public_key(key)
    files = []
    for index, entry in enumerate(manifest.files):
        files.append(_checked(entry, Path(path).parent))
        if progress is not None:
            progress("checking", index)
    files += [
        SealFinding(name, "added", "not there when it was sealed")
        for name in added_files(manifest, path)
    ]
    signed = manifest.signature
    state = "none"
    if signed is not None:
        state = _signature_state(
            signed.public_key, wanted, lambda: signature_holds(manifest)
        )
    good = state in ("valid",) or (wanted is None and state in ("none", "unchecked"))
    intact = good and all(file.state == "unaltered" for file in files)
    facts = (manifest.examiner, manifest.date, manifest.tool)
    return CaseVerdict(
        intact,
        files,
        state,
        "" if signed is None else signed.public_key,
        manifest.note,
        ", ".join(fact for fact in facts if fact),
    )


def _signature_state(signer: str, wanted: str | None, holds: Callable[[], bool]) -> str:
    try:
        if not holds():
            return "invalid"
    except SceneTraceError:
        if wanted is not None:
            raise
        return "unchecked"
    return "valid" if wanted in (None, signer) else "other key"


def _checked(entry: Entry, folder: Path) -> SealFinding:
    file = folder / entry.name
    if not file.exists():
        return SealFinding(entry.name, "missing")
    try:
        size, digest = file_digest(file)
    except SceneTraceError as error:
        return SealFinding(entry.name, "unreadable", str(error))
    if digest == entry.sha256:
        return SealFinding(entry.name, "unaltered")
    sizes = f"{entry.bytes} bytes, now {size}; " if size != entry.bytes else ""
    then, now = short_digests(entry.sha256, digest)
    return SealFinding(entry.name, "altered", f"{sizes}SHA-256 was {then}, is {now}")
