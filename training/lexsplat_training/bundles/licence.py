"""Asks whether a bundle's licence is accepted."""

import sys
import textwrap

from ..command_line import InputError

ACCEPT = "--accept-licence (with make: LICENCE=yes)"


def ask(entry, accepted):
    """Shows an entry's licence; raises if it is not accepted by `accepted` or by an answer."""
    print(f"{entry.name}: {entry.title}")
    print(textwrap.indent(textwrap.fill(f"Licence: {entry.licence}. {entry.terms}", 96), "  "))
    print(f"  {entry.page}\n  about {entry.download} GB to download")
    if accepted:
        return
    if not sys.stdin.isatty():
        raise InputError(f"nobody can be asked whether the licence is accepted: use {ACCEPT}")
    try:
        answer = input("Do you accept this licence? yes or no: ")
    except EOFError:
        answer = ""
    if answer.strip().lower() != "yes":
        raise InputError("the licence was not accepted, so nothing was downloaded")
