"""Reads costs.toml: what everything costs, for one profile. It knows no name of a value."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

PROFILES = ("software", "gpu")
FILE = Path(__file__).resolve().parent.parent / "costs.toml"


class Costs:
    """The sections of costs.toml, their values as attributes. Never changed: see `changed`."""

    to_be_replaced: SimpleNamespace
    robots: SimpleNamespace
    gateway: SimpleNamespace
    nats: SimpleNamespace
    worker: SimpleNamespace
    checkpoint: SimpleNamespace
    failure: SimpleNamespace
    target: SimpleNamespace
    price: SimpleNamespace

    def __init__(self, sections: Mapping[str, Mapping[str, Any]]) -> None:
        for name, values in sections.items():
            setattr(self, name, SimpleNamespace(**values))

    def changed(self, values: Mapping[str, Any]) -> "Costs":
        """The same costs but for some values, by SECTION.KEY."""
        sections = {name: dict(vars(section)) for name, section in vars(self).items()}
        for name, value in values.items():
            section, _, key = name.partition(".")
            if key not in sections.get(section, {}):
                raise SystemExit(f"error: costs.toml has no {name}")
            sections[section][key] = value
        return Costs(sections)


def read_costs(profile: str) -> Costs:
    """The costs of a profile. A value that only one profile has is an error."""
    tables = tomllib.loads(FILE.read_text())
    own = {name: tables.pop(name) for name in PROFILES}
    merged = {
        name: {section: values | more.get(section, {}) for section, values in tables.items()}
        for name, more in own.items()
    }
    software, gpu = (
        {f"{section}.{key}" for section, values in merged[name].items() for key in values}
        for name in PROFILES
    )
    if alone := sorted(software ^ gpu):
        raise SystemExit(f"error: costs.toml has {alone[0]} for one profile only")
    return Costs(merged[profile])
