"""Packages that only some exports need."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from recorders.errors import SceneTraceError


def needed(module: str, package: str, extra: str, what: str) -> Any:
    """A module of a package that need not be installed.

    Args:
        module: what to import.
        package: its name for people.
        extra: of ours, that brings it.
        what: what needs it.

    Raises:
        SceneTraceError: it is not installed; says how it will be.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise SceneTraceError(
            f"{what} needs the package {package}, which is not installed ({error}):"
            f" pip install 'scenetrace[{extra}]'"
        ) from error
