"""Draw what the server's example `codes_over_time` measured.

In:  its CSV. Out: a PNG with one panel per scene: the cosine between 32-D codes and what their 15-D
     codes decode to, over keyframes, for both online stages, codes carried over and frozen.

    python plot_codes.py codes.csv codes_over_time.png       # needs matplotlib
"""

import argparse
import csv
from collections import defaultdict
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402

COLORS = {"linear": "#1f6fb4", "mlp": "#d1541f"}
LABELS = {"linear": "linear", "mlp": "auto-encoder"}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("csv", type=Path)
    parser.add_argument("png", type=Path)
    args = parser.parse_args()
    scenes = defaultdict(lambda: defaultdict(list))
    with args.csv.open() as rows:
        for row in csv.DictReader(rows):
            scenes[row["scene"]][row["stage"]].append(row)
    figure, axes = pyplot.subplots(1, len(scenes), figsize=(4.6 * len(scenes), 3.2), sharey=True,
                                   squeeze=False, layout="constrained")
    for axis, (scene, stages) in zip(axes[0], scenes.items()):
        for stage, rows in stages.items():
            keyframes = [int(row["keyframe"]) for row in rows]
            for kind, style in (("carried", "-"), ("frozen", ":")):
                values = [float(row[f"all_{kind}"]) for row in rows]
                axis.plot(keyframes, values, style, color=COLORS[stage],
                          label=f"{LABELS[stage]}, {kind}")
        axis.set_title(scene, fontsize=10)
        axis.set_xlabel("keyframes")
        axis.grid(alpha=0.3)
    axes[0][0].set_ylabel("cosine of all codes to their truth")
    axes[0][0].legend(fontsize=8, loc="lower left")
    figure.savefig(args.png, dpi=90)


if __name__ == "__main__":
    main()
