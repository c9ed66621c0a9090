"""Parameters: declared once, validated once, every error names field, value and range."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from recorders.errors import ConfigError
from recorders.parameters import Parameters, as_plain, configure, param, to_toml


@dataclass(frozen=True)
class Gate(Parameters):
    radius_px: float = param(
        4.0, "gate's radius", unit="px", low=0.5, high=100.0, source="PARTS 3"
    )
    kind: str = param("box", "its shape", choices=("box", "circle"))
    tries: int = param(3, "how often", low=1)
    on: bool = param(True, "whether it is used")


SECTIONS = {"gate": Gate}


def test_defaults_and_round_trip_through_toml() -> None:
    config = configure(SECTIONS)
    text = to_toml(config)
    assert (
        tomllib.loads(text)
        == as_plain(config)
        == {"gate": {"radius_px": 4.0, "kind": "box", "tries": 3, "on": True}}
    )
    for fact in ("px", "PARTS 3", "in [0.5, 100.0]", "one of box, circle"):
        assert fact in text


def test_a_file_and_assignments_in_that_order(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text('[gate]\nradius_px = 7\nkind = "circle"\n')
    config = configure(SECTIONS, file, ["gate.radius_px=8.5", "gate.on=false"])
    assert as_plain(config)["gate"] == {
        "radius_px": 8.5,
        "kind": "circle",
        "tries": 3,
        "on": False,
    }


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("gate.radius_px=0.1", "gate.radius_px = 0.1: must be in [0.5, 100.0]"),
        ("gate.radius_px=nan", "must be finite"),
        ("gate.radius_px=wide", "gate.radius_px = 'wide': must be float"),
        ("gate.tries=0", "gate.tries = 0: must be at least 1"),
        ("gate.tries=2.5", "gate.tries = '2.5': must be int"),
        ("gate.on=yes", "gate.on = 'yes': must be true or false"),
        ("gate.kind=star", "gate.kind = 'star': must be one of box, circle"),
        (
            "gate.size=1",
            "unknown parameter gate.size; gate has: radius_px, kind, tries, on",
        ),
        ("door.size=1", "no section 'door'"),
        ("gate.tries", "must be section.field=value"),
    ],
)
def test_every_error_says_what_and_what_instead(word: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        configure(SECTIONS, None, [word])
    assert message in str(caught.value)


def test_a_file_that_is_no_toml_and_one_that_is_not_there(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text("gate = [")
    with pytest.raises(ConfigError, match="not TOML"):
        configure(SECTIONS, file)
    with pytest.raises(ConfigError, match="No such file"):
        configure(SECTIONS, tmp_path / "none.toml")
    file.write_text("gate = 3")
    with pytest.raises(ConfigError, match="must be a table"):
        configure(SECTIONS, file)


def test_numbers_of_many_digits_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    for name in ("radius_px", "tries"):
        file.write_text(f"[gate]\n{name} = {'9' * 400}\n")
        with pytest.raises(
            ConfigError, match=f"gate.{name}: a number of 1329 bits is too large"
        ):
            configure(SECTIONS, file)


def test_recorded_values_of_another_kind_are_refused() -> None:
    with pytest.raises(ConfigError, match="must be int, not str"):
        configure(SECTIONS, values={"gate": {"tries": "3"}})
