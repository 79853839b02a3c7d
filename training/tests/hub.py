"""A hub on loopback, with the interface of the Hugging Face hub, that can misbehave.

Serves FOLDER/models/OWNER/NAME/... and FOLDER/datasets/OWNER/NAME/.... By hand:
`python tests/hub.py FOLDER [PORT]`.
"""

import hashlib
import json
import re
import sys
import threading
import time
from collections import defaultdict
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

COMMIT = "0123456789abcdef0123456789abcdef01234567"
LARGE = 1000  # bytes from which a file is listed with its SHA-256, and fetched from the storage
API = re.compile(r"/api/(models|datasets)/([^/]+/[^/]+)/(revision|tree)/([^/?]+)")
FILE = re.compile(r"/(?:(datasets)/)?([^/]+/[^/]+)/resolve/([^/]+)/(.+)")


@dataclass
class Fault:
    """How one answer to a request for a file goes wrong."""

    status: int = 0  # this status instead of the file
    after: str = ""  # with this Retry-After
    cut: int = -1  # break the connection off after so many bytes of the answer
    wrong: bool = False  # other bytes
    no_range: bool = False  # the whole file, whatever range is asked for


class Hub:
    """The server; `faults[path]` are used up one after the other, `seen` has (path, range)."""

    def __init__(self, folder, port=0):
        self.folder, self.faults, self.seen = Path(folder), defaultdict(list), []
        self.server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self.server.hub = self
        self.address = f"http://127.0.0.1:{self.server.server_port}"

    def __enter__(self):
        serve = self.server.serve_forever
        threading.Thread(target=serve, args=(0.02,), daemon=True).start()
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.server.server_close()


class Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    def do_GET(self):
        hub, path = self.server.hub, unquote(self.path)
        if found := API.match(path):
            kind, repo, what, _ = found.groups()
            folder = hub.folder / kind / repo
            self.json({"sha": COMMIT} if what == "revision" else listing(folder), folder.is_dir())
        elif found := FILE.match(path):
            kind, repo, commit, name = found.groups()
            file = hub.folder / (kind or "models") / repo / name
            if commit != COMMIT or not file.is_file():
                self.send_error(404)
            elif file.stat().st_size >= LARGE:
                self.send_response(302)
                self.send_header("Location", f"/storage/{file.relative_to(hub.folder)}")
                self.end_headers()
            else:
                self.file(file, name)
        elif path.startswith("/storage/"):
            file = hub.folder / path.removeprefix("/storage/")
            self.file(file, file.name)
        else:
            self.send_error(404)

    def json(self, value, there):
        if not there:
            self.send_error(404)
            return
        body = json.dumps(value).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def file(self, file, name):
        """Sends a file, or the range that is asked for, with the next fault if there is one."""
        hub, asked = self.server.hub, self.headers.get("Range")
        hub.seen.append((name, asked))
        fault = hub.faults[name].pop(0) if hub.faults[name] else Fault()
        if fault.status:
            self.send_response(fault.status)
            if fault.after:
                self.send_header("Retry-After", fault.after)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        size = file.stat().st_size
        start = int(asked.removeprefix("bytes=").rstrip("-")) if asked else 0
        start = 0 if fault.no_range else start
        self.send_response(206 if start else 200)
        self.send_header("Content-Length", str(size - start))
        if start:
            self.send_header("Content-Range", f"bytes {start}-{size - 1}/{size}")
        self.end_headers()
        with file.open("rb") as source:
            source.seek(start)
            left = fault.cut if fault.cut >= 0 else size
            while left and (piece := source.read(min(left, 1 << 20))):
                self.wfile.write(bytes(255 - byte for byte in piece) if fault.wrong else piece)
                left -= len(piece)
        if fault.cut >= 0:
            self.close_connection = True

    def log_message(self, *_):
        pass


def listing(folder):
    """Files of a repository as the hub lists them."""
    rows = []
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        path, size = str(file.relative_to(folder)), file.stat().st_size
        blob = hashlib.sha1(f"blob {size}\0".encode(), usedforsecurity=False)
        row = {"type": "file", "path": path, "size": size}
        if size >= LARGE:
            state = hashlib.sha256()
            with file.open("rb") as source:
                while piece := source.read(1 << 20):
                    state.update(piece)
            rows.append({**row, "oid": "0" * 40, "lfs": {"oid": state.hexdigest(), "size": size}})
        else:
            blob.update(file.read_bytes())
            rows.append({**row, "oid": blob.hexdigest()})
    return rows


if __name__ == "__main__":
    with Hub(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 0) as served:
        print(served.address, flush=True)
        while True:
            time.sleep(3600)
