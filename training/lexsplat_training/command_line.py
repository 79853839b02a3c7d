"""What the commands have in common: their argument parsers, and errors without a traceback."""

import argparse


class InputError(ValueError):
    """A user's file or argument does not fit. Its message is shown without a traceback."""


def parser(command, description, example):
    """An argument parser with the module's docstring and an example in its help."""
    return argparse.ArgumentParser(
        prog=f"lexsplat-training {command}",
        description=description,
        epilog=f"example:\n  python -m lexsplat_training {command} {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
