"""Every command explains itself, and its example is one that it accepts."""

import importlib
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from lexsplat_training.__main__ import COMMANDS

ROOT = Path(__file__).parent.parent


def module(command):
    """A command's module; skips if a library is not installed that only this command needs."""
    name = f"lexsplat_training.{COMMANDS[command][0]}"
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name.startswith("lexsplat_training"):
            raise
        pytest.skip(f"{error.name} is not installed")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_ends_with_an_example(command, capsys):
    with pytest.raises(SystemExit) as exit:
        module(command).main(["--help"])
    assert exit.value.code == 0
    example = f"example:\n  python -m lexsplat_training {command} {module(command).EXAMPLE}"
    assert capsys.readouterr().out.endswith(example + "\n")


@pytest.mark.parametrize("command", COMMANDS)
def test_example_is_accepted(command):
    loaded = module(command)
    example = shlex.split(loaded.EXAMPLE.replace("\\\n", ""))
    loaded.arguments_parser().parse_args(example)
    # Negative control: an option that no command has.
    with pytest.raises(SystemExit):
        loaded.arguments_parser().parse_args([*example, "--no-such-option"])


def run(*arguments):
    line = [sys.executable, "-m", "lexsplat_training", *arguments]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)


def test_without_a_command_all_are_listed():
    listed = run().stdout
    assert all(command in listed for command in COMMANDS)


def test_unknown_command_is_refused():
    refused = run("no-such-command")
    assert refused.returncode == 1
    assert "no command 'no-such-command'; there are furnish" in refused.stderr
