"""Plot how well codes stay readable, from the CSV of the server's example `codes_over_time`.

One panel per scene: the cosine between 32-D codes and what their 15-D codes decode to, over
keyframes, for both online stages, with codes carried over and frozen. Needs matplotlib.
"""

import csv
from collections import defaultdict
from pathlib import Path

from ..command_line import parser

EXAMPLE = "codes.csv codes_over_time.png"
COLORS = {"linear": "#1f6fb4", "mlp": "#d1541f"}
LABELS = {"linear": "linear", "mlp": "auto-encoder"}


def read(path):
    """{scene: {stage: [row]}} of the CSV."""
    scenes = defaultdict(lambda: defaultdict(list))
    with path.open() as rows:
        for row in csv.DictReader(rows):
            scenes[row["scene"]][row["stage"]].append(row)
    return scenes


def plot(scenes):
    """The figure."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    size = (4.6 * len(scenes), 3.2)
    figure, axes = pyplot.subplots(
        1, len(scenes), figsize=size, sharey=True, squeeze=False, layout="constrained"
    )
    for axis, (scene, stages) in zip(axes[0], scenes.items(), strict=True):
        for stage, rows in stages.items():
            keyframes = [int(row["keyframe"]) for row in rows]
            for kind, style in (("carried", "-"), ("frozen", ":")):
                values = [float(row[f"all_{kind}"]) for row in rows]
                label = f"{LABELS[stage]}, {kind}"
                axis.plot(keyframes, values, style, color=COLORS[stage], label=label)
        axis.set_title(scene, fontsize=10)
        axis.set_xlabel("keyframes")
        axis.grid(alpha=0.3)
    axes[0][0].set_ylabel("cosine of all codes to their truth")
    axes[0][0].legend(fontsize=8, loc="lower left")
    return figure


def arguments_parser():
    arguments = parser("plot-codes", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("csv", type=Path, help="written by codes_over_time --csv")
    add("png", type=Path, help="file to write")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    plot(read(args.csv)).savefig(args.png, dpi=90)
