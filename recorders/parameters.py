"""Parameters of a method: one frozen dataclass each, units in the names, validated once, printed
as TOML.

A method declares its parameters with `param`; the composition root lists the sections in a dict.
Nothing is registered by import.
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, get_type_hints

from recorders.errors import ConfigError
from recorders.toml_files import toml_bytes

_LARGEST_INT = 2**53
Plain = bool | int | float | str
_KINDS: dict[type, dict[str, Any]] = {}


def param(
    default: Plain,
    doc: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    source: str = "ours",
) -> Any:
    """Declare one parameter of a `Parameters` class.

    Args:
        default: its default; the annotation of the field must be the same type (bool, int, float
            or str).
        doc: one line on what it does.
        unit: its unit, ``""`` for a pure number.
        low: smallest allowed value, inclusive.
        high: largest allowed value, inclusive.
        choices: the allowed strings, for a str.
        source: paper and section, or ``ours``.
    """
    meta = {
        "doc": doc,
        "unit": unit,
        "low": low,
        "high": high,
        "choices": choices,
        "source": source,
    }
    return dataclasses.field(default=default, metadata=meta)


@dataclasses.dataclass(frozen=True)
class Parameters:
    """Base of all parameter classes: validates every field against its declared range."""

    def __post_init__(self) -> None:
        hints = _kinds(type(self))
        for field in dataclasses.fields(self):
            object.__setattr__(
                self,
                field.name,
                _checked(
                    type(self).__name__, field, hints[field.name], getattr(self, field.name)
                ),
            )


def _kinds(cls: type) -> dict[str, Any]:
    """What each field holds; Python works it out from text, which takes longer than the checks."""
    if cls not in _KINDS:
        _KINDS[cls] = get_type_hints(cls)
    return _KINDS[cls]


def _checked(owner: str, f: dataclasses.Field[Any], kind: type, value: object) -> Plain:
    name = f"{owner}.{f.name}"
    if isinstance(value, int) and not isinstance(value, bool):
        if abs(value) > _LARGEST_INT:
            raise ConfigError(f"{name}: a number of {value.bit_length()} bits is too large")
        value = float(value) if kind is float else value
    if type(value) is not kind:
        raise ConfigError(
            f"{name} = {value!r}: must be {kind.__name__}, not {type(value).__name__}"
        )
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{name} = {value}: must be finite")
    low, high, choices = (
        f.metadata.get("low"),
        f.metadata.get("high"),
        f.metadata.get("choices"),
    )
    if isinstance(value, (int, float)) and (
        (low is not None and value < low) or (high is not None and value > high)
    ):
        raise ConfigError(f"{name} = {value}: must be {_range(f)}")
    if choices and value not in choices:
        raise ConfigError(f"{name} = {value!r}: must be one of {', '.join(choices)}")
    assert isinstance(value, (bool, int, float, str))
    return value


def _range(f: dataclasses.Field[Any]) -> str:
    low, high = f.metadata.get("low"), f.metadata.get("high")
    if low is not None and high is not None:
        return f"in [{low}, {high}]"
    if low is not None:
        return f"at least {low}"
    if high is not None:
        return f"at most {high}"
    return "anything"


Sections = Mapping[str, type[Parameters]]
Config = dict[str, Parameters]


def configure(
    sections: Sections,
    file: str | Path | None = None,
    assignments: Iterable[str] = (),
    values: Mapping[str, Mapping[str, Any]] | None = None,
    others: Collection[str] = (),
) -> Config:
    """Build every section's parameters from defaults, then plain values, a TOML file, and
    ``key=value`` words.

    Args:
        sections: section name to parameter class, the whole of what may be set.
        file: a TOML file with a table per section; a part of the parameters is enough.
        assignments: words as after ``--set``: ``section.field=value``.
        values: a plain mapping as `as_plain` makes it (what a log recorded).
        others: sections that a file may hold for other commands; they are passed over.

    Raises:
        ConfigError: an unknown section or field, a value of the wrong kind or out of range.
    """
    chosen: dict[str, dict[str, Any]] = {name: {} for name in sections}
    for table in (values or {}, _read_toml(file) if file is not None else {}):
        for section, fields in table.items():
            if section in others and section not in sections:
                continue
            if not isinstance(fields, Mapping):
                raise ConfigError(f"{section} = {fields!r}: must be a table of parameters")
            for key, value in fields.items():
                _known(sections, f"{section}.{key}")
                chosen[section][key] = value
    for word in assignments:
        key, equals, text = word.partition("=")
        if not equals:
            raise ConfigError(f"--set {word}: must be section.field=value")
        section, name, kind = _known(sections, key.strip())
        chosen[section][name] = _parse(key.strip(), kind, text.strip())
    return {name: _built(name, cls, chosen[name]) for name, cls in sections.items()}


def named(
    section: str, file: str | Path | None = None, assignments: Iterable[str] = ()
) -> list[str]:
    """The fields of a section that a TOML file or ``section.field=value`` words name, in that
    order, each once.

    Raises:
        ConfigError: the file cannot be read.
    """
    fields = [] if file is None else list(_read_toml(file).get(section, {}))
    for word in assignments:
        at, _, name = word.partition("=")[0].strip().partition(".")
        fields += [name] if at == section else []
    return list(dict.fromkeys(fields))


def _built(section: str, cls: type[Parameters], values: Mapping[str, Any]) -> Parameters:
    try:
        return cls(**values)
    except ConfigError as error:  # the person knows the section, not the class
        raise ConfigError(
            str(error).replace(f"{cls.__name__}.", f"{section}.", 1)
        ) from error


def _read_toml(file: str | Path) -> dict[str, Any]:
    try:
        return tomllib.loads(toml_bytes(Path(file)).decode())
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:  # whatever tomllib makes of it
        raise ConfigError(f"{file}: not TOML: {error}") from error


def _known(sections: Sections, key: str) -> tuple[str, str, type]:
    section, _, name = key.partition(".")
    if section not in sections:
        raise ConfigError(
            f"unknown parameter {key}: no section {section!r}; sections:"
            f" {', '.join(sorted(sections))}"
        )
    hints = _kinds(sections[section])
    names = [field.name for field in dataclasses.fields(sections[section])]
    if name not in names:
        raise ConfigError(f"unknown parameter {key}; {section} has: {', '.join(names)}")
    return section, name, hints[name]


def _parse(key: str, kind: type, text: str) -> Plain:
    if kind is bool:
        if text.lower() in ("true", "false"):
            return text.lower() == "true"
        raise ConfigError(f"{key} = {text!r}: must be true or false")
    if kind is str:
        return text
    try:
        return kind(text)  # type: ignore[no-any-return]
    except ValueError:
        raise ConfigError(f"{key} = {text!r}: must be {kind.__name__}") from None


def as_plain(config: Mapping[str, Parameters]) -> dict[str, dict[str, Plain]]:
    """Every parameter as plain data, sections and fields sorted: what a log records."""
    return {s: dict(sorted(dataclasses.asdict(config[s]).items())) for s in sorted(config)}


def to_toml(config: Mapping[str, Parameters]) -> str:
    """Every parameter as TOML with its meaning, unit, range and source as a comment above it."""
    lines: list[str] = []
    for section, parameters in config.items():
        lines += ["", f"[{section}]"]
        for field in dataclasses.fields(parameters):
            lines += [
                f"# {_comment(field)}",
                f"{field.name} = {_toml_value(getattr(parameters, field.name))}",
            ]
    return "\n".join(lines[1:]) + "\n"


def _comment(f: dataclasses.Field[Any]) -> str:
    meta = f.metadata
    facts = [
        meta.get("unit", ""),
        _range(f) if meta.get("low") is not None or meta.get("high") is not None else "",
    ]
    if meta.get("choices"):
        facts.append("one of " + ", ".join(meta["choices"]))
    facts.append(f"source: {meta.get('source', 'ours')}")
    return f"{meta.get('doc', f.name)} ({'; '.join(fact for fact in facts if fact)})"


def _toml_value(value: Plain) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)
