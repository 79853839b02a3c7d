#!/usr/bin/env python3
"""Asks a running server for several words, with the standard library and NumPy only.

    ask.py 127.0.0.1:8080 MAP FRAME chair table floor

Prints each word's share of a frame's view and of the map, and the object nearest to the origin for
the first word. Fails where the answers contradict each other.
"""

import io
import json
import sys
import urllib.request
from urllib.parse import urljoin

import numpy as np

# Requests to the local network must not go through a proxy.
OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))


class Map:
    """A map of a server."""

    def __init__(self, address, name):
        self.address, self.name = address, name

    def get(self, path, body=None, accept="application/json"):
        """The bytes of an answer; with a body the request is a POST."""
        headers = {"Content-Type": "application/json", "Accept": accept}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"http://{self.address}{path}", data, headers)
        return OPENER.open(request).read()

    def array(self, link):
        """A part of an answer as an array; `link` is relative to the question's address."""
        path = urljoin(f"/v1/maps/{self.name}/query", link)
        return np.load(io.BytesIO(self.get(path, accept="application/x-npy")))

    def query(self, **body):
        """The answer to a query."""
        return json.loads(self.get(f"/v1/maps/{self.name}/query", body))


def main():
    address, name, frame, *texts = sys.argv[1:]
    asked = Map(address, name)
    view = asked.query(texts=texts, view={"frame": int(frame)})
    labels = asked.array(view["labels"]["url"])
    assert labels.shape == (view["labels"]["height"], view["labels"]["width"])
    assert labels.dtype == np.uint8
    points = asked.array(asked.query(texts=texts)["points"]["url"])
    for entry in view["legend"]:
        in_view = (labels == entry["label"]).mean()
        in_map = (points[:, 3] == entry["label"]).mean()
        difference = abs(in_view - entry["share"])
        assert difference < 1e-4, f"{in_view} of the pixels, {entry['share']} in the legend"
        print(f"{entry['text']}: {in_view:.1%} of the view, {in_map:.1%} of the map")
    nearest = asked.query(text=texts[0], near_metres=[0, 0, 0], threshold=0)["objects"]
    distances = [item["distance_metres"] for item in nearest]
    assert distances == sorted(distances), distances
    if nearest:
        centre = nearest[0]["center_metres"]
        print(f"nearest {texts[0]}: {distances[0]:.2f} m from the origin, centre {centre}")


if __name__ == "__main__":
    main()
