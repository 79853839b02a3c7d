"""The manifest of models/tiny is what the command writes."""

from pathlib import Path

import onnx

from lexsplat_training.export import tiny

TINY = Path(__file__).parent.parent.parent / "models" / "tiny"


def test_shipped_manifest_is_reproduced(tmp_path):
    line = "--text text --encoder pair --compressor compressor --version 4 --temperature 10 "
    line += "--bias 2.9 --threshold 0.5 --present 0.62 --steepness 10.9 --out"
    args = tiny.arguments_parser().parse_args([*line.split(), str(tmp_path / "tiny")])
    files = tiny.sources(args)
    for name in files:
        (args.out / name).parent.mkdir(exist_ok=True)
        (args.out / name).write_bytes((TINY / name).read_bytes())
    graphs = [onnx.load(TINY / name).graph for name in ("encoder.onnx", "srd.onnx")]
    tiny.manifest(args, *graphs).write(args.out, files)
    assert (args.out / "manifest.toml").read_text() == (TINY / "manifest.toml").read_text()
