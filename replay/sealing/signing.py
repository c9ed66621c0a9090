"""Ed25519 signatures over a manifest, by the library ``cryptography`` (the extra ``sign``)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec

from recorders.errors import RecordingError, UsageError
from replay.sealing.manifest import Manifest, Signature

PUBLIC_SUFFIX = ".pub"


def _library() -> Any:
    try:
        import cryptography.exceptions
        import cryptography.hazmat.primitives.asymmetric.ed25519
        import cryptography.hazmat.primitives.serialization
    except ImportError as error:
        raise UsageError(
            "signatures need the package `cryptography`: pip install 'scenetrace[sign]'"
            " (everything else works without)"
        ) from error
    return cryptography


def new_key(path: str | Path) -> Path:
    """Make a key pair: the private key in ``path`` (readable by its owner alone), the public one
    beside it.

    Returns:
        the public key's file, ``<path>.pub``: the one to hand out.

    Raises:
        RecordingError: one of the files exists; a key is never overwritten.
        UsageError: the package ``cryptography`` is not installed.
    """
    library = _library()
    serialization = library.hazmat.primitives.serialization
    private, public = Path(path), Path(f"{path}{PUBLIC_SUFFIX}")
    for file in (private, public):
        if file.exists():
            raise RecordingError(
                "exists already, and a key is never overwritten; give another name", file
            )
    key = library.hazmat.primitives.asymmetric.ed25519.Ed25519PrivateKey.generate()
    pem = serialization.Encoding.PEM
    secret = key.private_bytes(
        pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    shown = key.public_key().public_bytes(
        pem, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    for file, data, mode in ((private, secret, 0o600), (public, shown, 0o644)):
        try:
            descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        except OSError as error:
            raise RecordingError(f"cannot be written: {error.strerror}", file) from error
        with os.fdopen(descriptor, "wb") as out:
            out.write(data)
    return public


def sign(manifest: Manifest, key: str | Path) -> Manifest:
    """The manifest with a signature by a private key (PEM, Ed25519, not encrypted).

    Raises:
        UsageError: the file is no such key, or the package ``cryptography`` is not installed.
    """
    library = _library()
    serialization = library.hazmat.primitives.serialization
    private = _key(
        key,
        library,
        lambda data: serialization.load_pem_private_key(data, password=None),
        "private",
    )
    raw = private.public_key().public_bytes(
        serialization.Encoding.Raw, serialization.PublicFormat.Raw
    )
    made = Signature("Ed25519", raw.hex(), private.sign(manifest.canonical()).hex())
    return msgspec.structs.replace(manifest, signature=made)


def public_key(path: str | Path) -> str:
    """A public key file's key (PEM, Ed25519) in hexadecimal.

    Raises:
        UsageError: the file is no such key, or the package ``cryptography`` is not installed.
    """
    library = _library()
    serialization = library.hazmat.primitives.serialization
    found = _key(path, library, serialization.load_pem_public_key, "public")
    raw: bytes = found.public_bytes(
        serialization.Encoding.Raw, serialization.PublicFormat.Raw
    )
    return raw.hex()


def _key(path: str | Path, library: Any, load: Any, kind: str) -> Any:
    try:
        found = load(Path(path).read_bytes())
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, TypeError, library.exceptions.UnsupportedAlgorithm) as error:
        reason = (
            "it is encrypted" if isinstance(error, TypeError) else "it is something else"
        )
        raise UsageError(
            f"{path}: must be a {kind} Ed25519 key in PEM ({reason}); `scenetrace seal"
            " --new-key`"
        ) from error
    ed25519 = library.hazmat.primitives.asymmetric.ed25519
    wanted = ed25519.Ed25519PrivateKey if kind == "private" else ed25519.Ed25519PublicKey
    if not isinstance(found, wanted):
        raise UsageError(
            f"{path}: must be a {kind} Ed25519 key, not {type(found).__name__}"
        )
    return found


def signature_holds(manifest: Manifest) -> bool:
    """Whether the manifest is what its signature was made over.

    Raises:
        UsageError: the package ``cryptography`` is not installed.
    """
    library = _library()
    signed = manifest.signature
    if signed is None:
        return False
    ed25519 = library.hazmat.primitives.asymmetric.ed25519
    try:
        key = ed25519.Ed25519PublicKey.from_public_bytes(bytes.fromhex(signed.public_key))
        key.verify(bytes.fromhex(signed.signature), manifest.canonical())
    except (library.exceptions.InvalidSignature, ValueError):
        return False
    return True
