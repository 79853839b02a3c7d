"""Images as inputs of a bundle."""

import numpy as np

from ..samples import images


def tensor(image, spec):
    """An image uint8 [h, w, 3] as float32 [1, 3, height, width].

    spec: the manifest's [image]; images are squashed and smoothed where they shrink.
    """
    x = images.resize(image, spec["width"], spec["height"], images.BILINEAR)
    x = x[..., ::-1] if spec["channel_order"] == "bgr" else x
    x = (x.astype(np.float32) - spec["mean"]) / spec["std"]
    return x.transpose(2, 0, 1)[None].astype(np.float32)
