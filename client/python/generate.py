#!/usr/bin/env python3
"""Writes src/lexsplat/v1/ from proto/lexsplat/v1/lexsplat.proto.

    python3 -m venv .venv && .venv/bin/pip install grpcio-tools==1.76.0
    .venv/bin/python client/python/generate.py

The version is pinned because the files need a runtime that is at least as new.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROTO = "lexsplat/v1/lexsplat.proto"


def generate(target: Path) -> None:
    """Writes the messages, their types and the stubs below `target`."""
    from grpc_tools import protoc

    protos = HERE.parent.parent / "proto"
    options = [f"--{kind}_out={target}" for kind in ("python", "pyi", "grpc_python")]
    if protoc.main(["protoc", f"--proto_path={protos}", *options, PROTO]):
        raise SystemExit("protoc failed, see above")


if __name__ == "__main__":
    generate(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "src")
