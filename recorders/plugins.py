"""Code of somebody else's, by name: entry points of installed packages, or ``module:Class``.

Each group has a Protocol of its own, which whoever uses the plug-in holds it to:

=========================  ============================================
``scenetrace.trackers``    `replay.trackers.tracker.Tracker`
``scenetrace.detectors``   `recorders.detectors.detector.Detector`
``scenetrace.sources``     `recorders.sources.Source`
``scenetrace.questions``   a `reasoning.questions.ready_questions.Question`
=========================  ============================================

A name of scenetrace's own never reaches this module, so no package can take one over.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

from recorders.errors import SceneTraceError, UsageError

TRACKERS = "scenetrace.trackers"
DETECTORS = "scenetrace.detectors"
SOURCES = "scenetrace.sources"
QUESTIONS = "scenetrace.questions"


@dataclass(frozen=True)
class Plugin:
    """What a name led to.

    Attributes:
        name: the name that leads to it again: an entry point's, or ``module:Class``.
        value: the object itself.
        version: the package with its version, if it is an entry point's, and the SHA-256 of its
            source, as `version_of` gives them.
    """

    name: str
    value: Any
    version: str


def _entry_points(**chosen: str) -> Any:
    from importlib.metadata import entry_points  # which brings a mail parser along

    return entry_points(**chosen)


def names(group: str) -> list[str]:
    """The names that installed packages give in a group, sorted."""
    return sorted({entry.name for entry in _entry_points(group=group)})


def load(group: str, name: str, own: Iterable[str] = (), *, beside: bool = True) -> Plugin:
    """The plug-in of a name.

    Args:
        group: one of the groups above.
        name: an entry point's name, or ``module:Class`` of any module that can be imported.
        own: scenetrace's own names, for the message.
        beside: look for modules in the working folder, too. Never for a name that a file says:
            it must not choose which code lies beside it and runs.

    Raises:
        UsageError: there is no such plug-in, or two packages give the name.
        SceneTraceError: it is there and cannot be imported.
    """
    kind = group.rpartition(".")[2].removesuffix("s")
    if ":" in name:
        value = _addressed(kind, name, beside)
        return Plugin(name, value, version_of(value))
    found = list(_entry_points(group=group, name=name))
    if not found:
        known = ", ".join([*own, *names(group)])
        raise UsageError(
            f"unknown {kind} {name!r}; there are: {known}; or give module:Class"
        )
    addresses = sorted({entry.value for entry in found})
    if len(addresses) > 1:
        raise UsageError(
            f"the {kind} {name!r} is given by more than one package; choose one:"
            f" {', '.join(addresses)}"
        )
    entry = found[0]
    try:
        value = entry.load()
    except Exception as error:
        raise SceneTraceError(
            f"the {kind} {name!r} ({entry.value}): {_said(error)}"
        ) from error
    package = "" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    return Plugin(name, value, version_of(value, package))


def _addressed(kind: str, address: str, beside: bool) -> Any:
    module_name, _, path = address.partition(":")
    here = str(Path.cwd())
    if beside and here not in sys.path:
        sys.path.append(here)
    try:
        found: Any = import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):
            raise SceneTraceError(f"the {kind} {address}: {_said(error)}") from error
        raise UsageError(
            f"the {kind} {address}: there is no module {module_name!r}"
            f"{' here, nor' if beside else ''} among the installed packages"
        ) from error
    except Exception as error:
        raise SceneTraceError(f"the {kind} {address}: {_said(error)}") from error
    for part in path.split("."):
        if not hasattr(found, part):
            raise UsageError(f"the {kind} {address}: {module_name} has no {path!r}")
        found = getattr(found, part)
    return found


def _said(error: Exception) -> str:
    lines = str(error).splitlines()
    return f"cannot be imported: {type(error).__name__}: {lines[0] if lines else ''}"


def unbound(value: Any) -> Any:
    """What a `functools.partial` calls; anything else itself."""
    return value.func if isinstance(value, partial) else value


def address_of(value: Any) -> str | None:
    """``module:Class`` from which another process can import it; None where there is none (made
    inside a function, a lambda, a `functools.partial`).
    """
    module = getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None)
    if not module or not name or "<" in name or module == "__main__":
        return None
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    return f"{module}:{name}" if found is value else None


def version_of(value: Any, package: str = "") -> str:
    """A package with its version, then the SHA-256 of the source that it comes from: all modules
    of its package, or its one module.
    """
    value = unbound(value)
    digest = _digest(*_sources(getattr(value, "__module__", "") or "")) or _own_text(value)
    return " ".join(part for part in (package, digest and f"sha256:{digest}") if part)


def _sources(module: str) -> tuple[Path, tuple[Path, ...]]:
    """A folder and the files below it whose code runs."""
    top = sys.modules.get(module.partition(".")[0])
    beginning = Path(getattr(top, "__file__", None) or "")
    if beginning.name == "__init__.py":
        return beginning.parent, tuple(sorted(beginning.parent.rglob("*.py")))
    file = Path(getattr(sys.modules.get(module), "__file__", None) or "")
    return file.parent, (file,) if file.suffix == ".py" else ()


@cache  # what has been imported is what runs, whatever becomes of the files
def _digest(folder: Path, files: tuple[Path, ...]) -> str:
    whole = hashlib.sha256()
    for file in files:
        data = file.read_bytes() if file.is_file() else b""
        whole.update(f"{file.relative_to(folder).as_posix()} {len(data)}\n".encode() + data)
    return whole.hexdigest() if files else ""


def _own_text(value: Any) -> str:
    try:
        return hashlib.sha256(inspect.getsource(value).encode()).hexdigest()
    except (OSError, TypeError):
        return ""
