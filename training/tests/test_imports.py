"""Which folder of the package may import which, so that imports run in one direction."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "lexsplat_training"
ALLOWED = {
    "scenes": set(),
    "samples": set(),
    "networks": set(),
    "runtime": {"samples"},
    "export": {"networks", "runtime"},
    "train": {"samples", "networks", "runtime", "export"},
    "measure": {"samples", "runtime"},
    "bundles": {"samples", "networks", "runtime", "export", "measure"},
}


def imported(path):
    """The folders of the package that a file imports from, other than its own."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == 2:
            first = (node.module or "").split(".")[0]
            yield from [first] if first else [alias.name for alias in node.names]
        elif isinstance(node, ast.Import | ast.ImportFrom) and not getattr(node, "level", 0):
            names = [alias.name for alias in node.names]
            named = [getattr(node, "module", None) or "", *names]
            assert not any(name.startswith("lexsplat_training") for name in named), path


def test_every_folder_is_listed():
    assert {path.parent.name for path in PACKAGE.glob("*/__init__.py")} == set(ALLOWED)


@pytest.mark.parametrize("folder", ALLOWED)
def test_folder_imports_only_what_it_may(folder):
    files = sorted((PACKAGE / folder).glob("*.py"))
    found = {name for path in files for name in imported(path)}
    assert found & set(ALLOWED) <= ALLOWED[folder]


def test_no_file_is_longer_than_400_lines():
    for path in PACKAGE.rglob("*.py"):
        assert len(path.read_text().splitlines()) <= 400, path
