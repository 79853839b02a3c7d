"""The interface of the Hugging Face hub and its mirrors: what a repository has, and where."""

import json
import re
from dataclasses import dataclass
from pathlib import PurePosixPath
from urllib.parse import quote, urljoin

from ..command_line import InputError
from . import download
from .download import Digest

HUB = "https://huggingface.co"
NEXT = re.compile(r'<([^>]+)>;\s*rel="next"')  # in the header Link of a list with further pages


@dataclass(frozen=True)
class Listed:
    """A file of a repository as the hub lists it."""

    path: str
    size: int  # bytes
    digest: Digest


def split(repo):
    """("models" or "datasets", "OWNER/NAME") of a repository as the catalogue names it."""
    kind, _, name = repo.partition("/")
    if kind not in ("models", "datasets") or name.count("/") != 1:
        raise InputError(f"{repo}: expected models/OWNER/NAME or datasets/OWNER/NAME")
    return kind, name


def revision(hub, repo):
    """The commit of a repository's main branch."""
    kind, name = split(repo)
    body, _ = download.text(f"{hub}/api/{kind}/{name}/revision/main")
    return json.loads(body)["sha"]


def listing(hub, repo, commit):
    """Every file of a repository at a commit."""
    kind, name = split(repo)
    url, rows = f"{hub}/api/{kind}/{name}/tree/{commit}?recursive=true", []
    while url:
        body, headers = download.text(url)
        rows += [listed(row) for row in json.loads(body) if row["type"] == "file"]
        further = NEXT.search(headers.get("Link", ""))
        url = urljoin(url, further[1]) if further else None
    return rows


def listed(row):
    """A file of a listing. Large ones have a SHA-256, small ones are named by git's digest."""
    large = row.get("lfs")
    digest = Digest("sha256", large["oid"]) if large else Digest("git", row["oid"])
    return Listed(row["path"], (large or row)["size"], digest)


def choose(files, names):
    """The first of `names` that is among the listed files; None if none is."""
    for name in names:
        for file in files:
            if name in (file.path, PurePosixPath(file.path).name):
                return file
    return None


def address(hub, repo, commit, path):
    """Where a file of a repository is downloaded from."""
    kind, name = split(repo)
    prefix = "" if kind == "models" else f"{kind}/"
    return f"{hub}/{prefix}{name}/resolve/{commit}/{quote(path)}"
