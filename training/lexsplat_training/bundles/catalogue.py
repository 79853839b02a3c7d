"""The bundles that can be made: `catalogue.toml` as objects."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from ..command_line import InputError

FILE = Path(__file__).with_name("catalogue.toml")


@dataclass(frozen=True)
class Source:
    """A file that a bundle is made from."""

    repo: str  # models/OWNER/NAME or datasets/OWNER/NAME
    names: tuple[str, ...]  # paths in it, the first one that exists is taken
    by_hand: str = ""  # where a person gets it if the hub does not have it


@dataclass(frozen=True)
class Entry:
    """A bundle that can be made."""

    name: str
    title: str
    licence: str
    terms: str
    page: str
    download: float  # GB, about
    packages: str  # file of requirements
    convert: str  # the module from_... that converts the files
    options: dict
    files: dict[str, Source]


def read(path=FILE):
    """All entries by name."""
    entries = {}
    for name, row in tomllib.loads(path.read_text()).items():
        sources = {
            role: Source(file["repo"], tuple(file["names"]), file.get("by_hand", ""))
            for role, file in row.pop("files").items()
        }
        row["terms"] = " ".join(row["terms"].split())
        entries[name] = Entry(name=name, files=sources, **row)
    return entries


def entry(name, path=FILE):
    """The entry of a name."""
    entries = read(path)
    if name not in entries:
        lines = "".join(f"\n  {key:10} {one.title}" for key, one in entries.items())
        raise InputError(f"expected the NAME of a bundle, found {name!r}; there are{lines}")
    return entries[name]
