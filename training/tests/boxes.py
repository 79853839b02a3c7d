"""Stands in for `lexsplat synth`: frames of colored boxes with labels, in Replica layout."""

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

NAMES = {1: "wall", 2: "floor", 3: "bed", 4: "chair", 5: "lamp"}
WIDTH, HEIGHT, FRAMES = 96, 72, 4


def main():
    """Writes the folder that the command line `synth FOLDER --seed N ...` names."""
    folder, seed = Path(sys.argv[2]), int(sys.argv[sys.argv.index("--seed") + 1])
    random = np.random.default_rng(seed)
    (folder / "results").mkdir(parents=True)
    (folder / "semantic").mkdir()
    colors = np.random.default_rng(0).integers(0, 255, (len(NAMES) + 1, 3))
    for frame in range(FRAMES):
        label = np.full((HEIGHT, WIDTH), 1, np.uint16)
        label[HEIGHT // 2 :] = 2
        for number in random.choice([3, 4, 5], 2, replace=False):
            x, y = random.integers(0, WIDTH - 32), random.integers(0, HEIGHT - 24)
            label[y : y + 24, x : x + 32] = number
        color = colors[label] + random.integers(-20, 20, (*label.shape, 3))
        image = Image.fromarray(color.clip(0, 255).astype(np.uint8))
        image.save(folder / "results" / f"frame{frame:06}.jpg")
        Image.fromarray(label).save(folder / "semantic" / f"{frame:06}.png")
    rows = [{"id": number, "class": name} for number, name in NAMES.items()]
    (folder / "instances.json").write_text(json.dumps(rows))
    np.savetxt(folder / "traj.txt", np.tile(np.eye(4).ravel(), (FRAMES, 1)))


if __name__ == "__main__":
    main()
