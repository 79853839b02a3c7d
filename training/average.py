"""The weighted mean of several runs' weights, which all went on from the same weights.

In:  two or more encoder.pt (from encoder.py), one weight each.
Out: encoder.pt, encoder.onnx and srd.onnx of the mean.
"""

import argparse
from pathlib import Path

import torch

import encoder as networks


def mean(states, weights):
    """The mean of state dicts; counters and the like are the first's."""
    first = states[0]
    return {key: sum(state[key] * w for state, w in zip(states, weights))
            if value.is_floating_point() else value for key, value in first.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+", help="encoder.pt")
    parser.add_argument("--weights", type=float, nargs="+", required=True, help="they sum to 1")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    args = parser.parse_args()
    if len(args.weights) != len(args.files) or abs(sum(args.weights) - 1) > 1e-6:
        parser.error("one weight per file is needed, and their sum must be 1")
    runs = [torch.load(path) for path in args.files]
    for part in ("encoder", "srd"):
        runs[0][part] = mean([run[part] for run in runs], args.weights)
    args.out.mkdir(parents=True, exist_ok=True)
    torch.save(runs[0], args.out / "encoder.pt")
    networks.export(*networks.load(args.out / "encoder.pt"), args.out)
    print(f"wrote {args.out}")


if __name__ == "__main__":
    main()
