"""Average the weights of several training runs that started from the same weights.

Writes encoder.pt, encoder.onnx and srd.onnx of the weighted mean.
"""

from pathlib import Path

import torch

from ..command_line import parser
from ..export.graphs import export_encoder
from ..networks.encoder import load

EXAMPLE = "first/encoder.pt second/encoder.pt --weights 0.4 0.6 --out mean"


def mean(states, weights):
    """The weighted mean of state dicts; integers (counters) are those of the first."""
    first = states[0]
    return {
        key: sum(state[key] * w for state, w in zip(states, weights, strict=True))
        if value.is_floating_point()
        else value
        for key, value in first.items()
    }


def arguments_parser():
    arguments = parser("average-weights", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("files", type=Path, nargs="+", help="encoder.pt of each run")
    add("--weights", type=float, nargs="+", required=True, help="their sum is 1")
    add("--out", type=Path, required=True, help="folder to write to")
    return arguments


def main(arguments=None):
    reader = arguments_parser()
    args = reader.parse_args(arguments)
    if len(args.weights) != len(args.files) or abs(sum(args.weights) - 1) > 1e-6:
        reader.error("expected one weight per file and a sum of 1")
    runs = [torch.load(path) for path in args.files]
    for part in ("encoder", "srd"):
        runs[0][part] = mean([run[part] for run in runs], args.weights)
    args.out.mkdir(parents=True, exist_ok=True)
    torch.save(runs[0], args.out / "encoder.pt")
    export_encoder(*load(args.out / "encoder.pt"), args.out)
    print(f"wrote {args.out}")
