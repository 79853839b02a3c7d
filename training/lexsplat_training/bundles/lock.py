"""The lock file: which bytes a bundle is made from.

A file that is not in it is trusted when it is first downloaded, if it has the digest that the hub
lists for it. From then on its size and SHA-256 are fixed.
"""

import json
import tomllib
from dataclasses import asdict, dataclass

HEAD = """\
# Digests of the files that `make bundle` downloads. The first download of a file adds it here, once
# it has the digest that the hub lists; later ones must have the same bytes.
"""


@dataclass(frozen=True)
class Locked:
    """A file on the hub, and its bytes."""

    repo: str  # as in the catalogue; "" for a file that was put there by hand
    revision: str  # commit of the repository
    path: str  # in the repository
    size: int  # bytes
    sha256: str


class Lock:
    """A lock file; entries are found by the bundle's name and the file's role."""

    def __init__(self, path):
        self.path = path
        text = path.read_text() if path.exists() else ""
        self.entries = {key: Locked(**row) for key, row in tomllib.loads(text).items()}

    def find(self, name, role):
        """The entry of a bundle's file, or None."""
        return self.entries.get(f"{name}.{role}")

    def add(self, name, role, locked):
        """Adds an entry and writes the file."""
        self.entries[f"{name}.{role}"] = locked
        parts = [HEAD]
        for key, row in sorted(self.entries.items()):
            lines = [f"{field} = {json.dumps(value)}\n" for field, value in asdict(row).items()]
            parts.append(f"\n[{json.dumps(key)}]\n{''.join(lines)}")
        fresh = self.path.with_name(self.path.name + ".new")
        fresh.write_text("".join(parts))
        fresh.replace(self.path)
