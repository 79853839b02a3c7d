#!/usr/bin/env python3
"""Asks a lexsplat server which of several things is what, with nothing but the standard library and NumPy.

    ask.py 127.0.0.1:8080 MAP FRAME chair table floor

Prints each word's share of the frame's view and of the map, and where the nearest thing of the first word is.
"""

import io
import json
import sys
import urllib.request

import numpy as np

address, name, frame, *texts = sys.argv[1:]
# Servers on the local network need no proxy.
opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))


def get(path, body=None, accept="application/json"):
    headers = {"Content-Type": "application/json", "Accept": accept}
    data = None if body is None else json.dumps(body).encode()
    return opener.open(urllib.request.Request(f"http://{address}{path}", data, headers)).read()


def ask(**body):
    return json.loads(get(f"/v1/maps/{name}/query", body))


view = ask(texts=texts, view={"frame": int(frame)})
labels = np.load(io.BytesIO(get(view["labels"]["url"], accept="application/x-npy")))
assert labels.shape == (view["labels"]["height"], view["labels"]["width"]) and labels.dtype == np.uint8
space = ask(texts=texts)
points = np.load(io.BytesIO(get(space["points"]["url"], accept="application/x-npy")))
for entry in view["legend"]:
    here, all_of_it = (labels == entry["label"]).mean(), (points[:, 3] == entry["label"]).mean()
    assert abs(here - entry["share"]) < 1e-4, f"{here} of the pixels, {entry['share']} in the legend"
    print(f"{entry['text']}: {here:.1%} of the view, {all_of_it:.1%} of the map")
nearest = ask(text=texts[0], near=[0, 0, 0], threshold=0)["objects"]
distances = [thing["distance"] for thing in nearest]
assert distances == sorted(distances), distances
if nearest:
    print(f"nearest {texts[0]}: {distances[0]:.2f} m from the origin, centre {nearest[0]['center']}")
