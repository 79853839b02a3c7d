"""A bundle's manifest.toml."""

import hashlib
import json
from dataclasses import dataclass


@dataclass
class Manifest:
    """What a manifest says. Keys and their meaning: see the server's bundle format."""

    name: str
    version: str
    licence: str
    feature_size: int
    code_size: int
    image: dict
    graphs: dict  # sections of the image graphs, by title: [vision], or [encoder] and [srd]
    compressor: dict
    text: dict
    relevancy: dict

    def write(self, folder, files):
        """Writes manifest.toml with the SHA-256 of every file."""
        head = ("name", "version", "licence", "feature_size", "code_size")
        checksums = {
            json.dumps(name): hashlib.sha256((folder / name).read_bytes()).hexdigest()
            for name in files
        }
        sections = {
            "image": self.image,
            **self.graphs,
            "compressor": self.compressor,
            "text": self.text,
            "relevancy": self.relevancy,
            "sha256": checksums,
        }
        parts = [lines({key: getattr(self, key) for key in head})]
        parts += [f"[{title}]\n{lines(values)}" for title, values in sections.items()]
        (folder / "manifest.toml").write_text("\n".join(parts))


def lines(values):
    """`key = value` lines."""
    return "".join(f"{key} = {toml(value)}\n" for key, value in values.items())


def toml(value):
    """A string, number, truth value, list of these, or table of these, as TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)
