"""The files of a catalogue's entry: downloaded, checked against the lock, or taken as given."""

from pathlib import PurePosixPath

from ..command_line import InputError
from . import download, hub
from .download import Digest
from .lock import Locked


def gather(entry, address, folder, lock):
    """Has every file of an entry in `folder`; returns their paths by role.

    address: of the hub. Files that are not in the lock are added to it.
    """
    return {role: one(entry, role, address, folder, lock) for role in entry.files}


def one(entry, role, address, folder, lock):
    """The path of one file of an entry."""
    source, locked = entry.files[role], lock.find(entry.name, role)
    if locked is None:
        locked = new(entry, role, address, folder)
        path = target(folder, locked)
        lock.add(entry.name, role, locked)
        print(f"{path.name}: locked, sha256 {locked.sha256}")
        return path
    path, digest = target(folder, locked), Digest("sha256", locked.sha256)
    if locked.repo:
        url = hub.address(address, locked.repo, locked.revision, locked.path)
        download.fetch(url, path, locked.size, digest)
    elif not path.exists():
        raise InputError(by_hand(source, folder))
    elif digest.of(path) != locked.sha256:
        raise InputError(f"{path}: expected sha256 {locked.sha256}, which {lock.path} pins")
    return path


def new(entry, role, address, folder):
    """The lock's entry of a file that was given by hand, or else downloaded."""
    source = entry.files[role]
    for name in source.names:
        path = folder / PurePosixPath(name).name
        if source.by_hand and path.exists():
            return Locked("", "", path.name, path.stat().st_size, download.sha256(path))
    commit = hub.revision(address, source.repo)
    file = hub.choose(hub.listing(address, source.repo, commit), source.names)
    if file is None and source.by_hand:
        raise InputError(by_hand(source, folder))
    if file is None:
        raise InputError(f"{source.repo}: expected {' or '.join(source.names)}, found no such file")
    path = folder / PurePosixPath(file.path).name
    url = hub.address(address, source.repo, commit, file.path)
    download.fetch(url, path, file.size, file.digest)
    return Locked(source.repo, commit, file.path, file.size, download.sha256(path))


def target(folder, locked):
    """Where a file is kept."""
    return folder / PurePosixPath(locked.path).name


def by_hand(source, folder):
    """What to do about a file that the hub does not have."""
    return (
        f"{source.names[0]}: the hub does not have it; {source.by_hand}. Put it into {folder} and "
        "run the command again"
    )
