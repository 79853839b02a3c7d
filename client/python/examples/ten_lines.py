"""Maps a folder of frames and asks where something is: `ten_lines.py FOLDER WORDS [SERVER]`.

`lexsplat synth room` writes such a folder.
"""

import json
import sys
from pathlib import Path

import lexsplat

if len(sys.argv) < 3:
    raise SystemExit(__doc__)
folder, words, *server = sys.argv[1:]
about = json.loads(Path(folder, "cam_params.json").read_text())["camera"]
camera = lexsplat.Camera(*(about[key] for key in ("w", "h", "fx", "fy", "cx", "cy")))
pictures = [sorted(Path(folder, "results").glob(kind)) for kind in ("frame*.jpg", "depth*.png")]
frames = (lexsplat.Frame(c.read_bytes(), d.read_bytes()) for c, d in zip(*pictures, strict=True))
room = lexsplat.Client(*server).map("ten-lines")
print(room.stream(frames, camera, poses="estimate", depth_unit=1 / about["scale"]))
answer = room.query(words, frame=0, wait_seconds=120)
print(answer.boxes[:3], answer.heatmap)
