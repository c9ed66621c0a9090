"""A chain of custody: a manifest of a case's files with their digests, optionally signed."""

from replay.sealing.checking import CaseVerdict, SealFinding, check_manifest
from replay.sealing.manifest import Entry, Manifest, read_manifest, seal
from replay.sealing.signing import new_key, sign

__all__ = [
    "CaseVerdict",
    "Entry",
    "Manifest",
    "SealFinding",
    "check_manifest",
    "new_key",
    "read_manifest",
    "seal",
    "sign",
]
