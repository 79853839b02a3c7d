"""Downloads a file so that it survives broken connections, a busy server and a stop in between.

Bytes go to a file that ends with `.part`, and a request asks for the rest of it (HTTP Range). The
file gets its name when its digest was checked. urllib is enough for this, so that nothing has to be
installed, and redirects to a hub's storage and proxies of the environment are followed.
"""

import hashlib
import http.client
import shutil
import sys
import time
import urllib.error
import urllib.request
from dataclasses import dataclass

from ..command_line import InputError

TRIES = 6  # attempts in a row that gain nothing
LONGEST_PAUSE = 60.0  # seconds
TIMEOUT = 60.0  # seconds without a byte
PIECE = 1 << 20
AGENT = {"User-Agent": "lexsplat-training", "Accept-Encoding": "identity"}
BUSY = (408, 425, 429, 500, 502, 503, 504)
WHY = {
    401: "the hub wants to know who asks: the repository is private, gated, or not there",
    403: "the hub refuses access: the repository is private or gated",
    404: "the hub has no such file",
}


@dataclass(frozen=True)
class Digest:
    """What a file must have: `kind` is sha256, or git (the name of a blob in git)."""

    kind: str
    value: str

    def of(self, path):
        """The digest of this kind of a file."""
        if self.kind == "sha256":
            return sha256(path)
        state = hashlib.sha1(f"blob {path.stat().st_size}\0".encode(), usedforsecurity=False)
        return hashed(path, state)


def sha256(path):
    """The SHA-256 of a file, hexadecimal."""
    return hashed(path, hashlib.sha256())


def hashed(path, state):
    """The digest of a file, hexadecimal; `state`: of hashlib."""
    with path.open("rb") as file:
        while piece := file.read(PIECE):
            state.update(piece)
    return state.hexdigest()


class Pauses:
    """Waits between attempts; gives up after TRIES in a row."""

    def __init__(self, first=1.0):
        self.first, self.count = first, 0

    def reset(self):
        """An attempt gained something."""
        self.count = 0

    def wait(self, reason, seconds=None):
        """Waits, for as long as the server said if it did; raises if this was the last attempt."""
        self.count += 1
        if self.count >= TRIES:
            raise InputError(f"{reason}; gave up after {TRIES} attempts, run the command again")
        pause = self.first * 2 ** (self.count - 1) if seconds is None else seconds
        pause = min(pause, LONGEST_PAUSE)
        print(f"{reason}; trying again in {pause:.0f} s", file=sys.stderr)
        time.sleep(pause)


def opened(url, offset=0):
    """A response to a request for the bytes from `offset` on."""
    headers = AGENT | ({"Range": f"bytes={offset}-"} if offset else {})
    return urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=TIMEOUT)


def attempt(url, pauses, action):
    """The result of `action()`; None if it has to be tried again, after a pause."""
    try:
        return action()
    except urllib.error.HTTPError as error:
        error.close()
        if error.code not in BUSY:
            raise InputError(f"{url}: {WHY.get(error.code, error.reason)} ({error.code})") from None
        after = error.headers.get("Retry-After", "")
        seconds = float(after) if after.isdecimal() else None
        pauses.wait(f"{url}: {error.code} {error.reason}", seconds)
    except (OSError, http.client.HTTPException) as error:
        pauses.wait(f"{url}: {getattr(error, 'reason', None) or error or type(error).__name__}")
    return None


def text(url):
    """(body, headers) of a small page."""

    def action():
        with opened(url) as response:
            return response.read().decode(), response.headers

    pauses = Pauses()
    while True:
        if found := attempt(url, pauses, action):
            return found


def fetch(url, path, size, digest):
    """Downloads a file of `size` bytes with a `Digest` to `path`, continuing what is there."""
    if path.exists() and path.stat().st_size == size and digest.of(path) == digest.value:
        print(f"{path.name}: is here already")
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{digest.value[:12]}.part")
    missing = size - (part.stat().st_size if part.exists() else 0)
    free = shutil.disk_usage(path.parent).free
    if missing > free:
        raise InputError(
            f"{path}: {missing / 1e9:.1f} GB are missing, the disk has {free / 1e9:.1f} GB"
        )
    pauses = Pauses()
    while (have := part.stat().st_size if part.exists() else 0) < size:
        attempt(url, pauses, lambda have=have: receive(url, part, have, size))
        if part.exists() and part.stat().st_size > have:
            pauses.reset()
    found = digest.of(part) if have == size else f"{have} bytes instead of {size}"
    if found != digest.value:
        part.unlink()
        raise InputError(
            f"{url}: expected {digest.kind} {digest.value}, found {found}; what was downloaded is "
            "deleted"
        )
    part.replace(path)


def receive(url, part, have, size):
    """Appends to `part` what the server sends from byte `have` on."""
    with opened(url, have) as response:
        # A server that does not know ranges begins anew.
        begins = have if response.status == 206 else 0
        with part.open("r+b" if part.exists() else "wb") as file:
            file.truncate(begins)
            file.seek(begins)
            shown = time.monotonic()
            while piece := response.read(PIECE):
                file.write(piece)
                begins += len(piece)
                if time.monotonic() - shown > 2 or begins == size:
                    shown = time.monotonic()
                    show(part, begins, size)
    if begins < size:
        raise ConnectionError(f"the connection broke off, {size - begins} bytes are missing")


def show(part, have, size):
    """Prints how far a download is: over the line before on a terminal."""
    name = part.name.rsplit(".", 2)[0]
    line = f"{name}: {have / 1e6:.0f} of {size / 1e6:.0f} MB"
    print(line, end="\r" if sys.stderr.isatty() and have < size else "\n", file=sys.stderr)
