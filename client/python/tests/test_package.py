"""The package itself: generated files, version, what it exports."""

import re
import subprocess
import sys
from pathlib import Path

import lexsplat

HERE = Path(__file__).resolve().parent.parent


def test_generated_files_are_those_of_the_protocol(tmp_path):
    subprocess.run([sys.executable, HERE / "generate.py", tmp_path], check=True)
    made = sorted((tmp_path / "lexsplat/v1").iterdir())
    assert [file.name for file in made] == [
        "lexsplat_pb2.py",
        "lexsplat_pb2.pyi",
        "lexsplat_pb2_grpc.py",
    ]
    for file in made:
        kept = HERE / "src/lexsplat/v1" / file.name
        assert file.read_text() == kept.read_text(), f"run {HERE / 'generate.py'}"
        installed = Path(lexsplat.__file__).parent / "v1" / file.name
        assert installed.read_text() == kept.read_text(), "the wheel has another version"


def test_the_version_is_that_of_the_project():
    cargo = (HERE.parent.parent / "Cargo.toml").read_text()
    (version,) = re.findall(r'^version = "(.*)"$', cargo, re.MULTILINE)
    assert f'version = "{version}"' in (HERE / "pyproject.toml").read_text()


def test_what_is_exported_is_documented_and_typed():
    assert (Path(lexsplat.__file__).parent / "py.typed").exists()
    for name in lexsplat.__all__:
        exported = getattr(lexsplat, name)
        assert exported.__doc__, name
        for member, value in vars(exported).items():
            if callable(value) and not member.startswith("_") and not isinstance(value, type):
                assert value.__doc__ or issubclass(exported, dict), f"{name}.{member}"
