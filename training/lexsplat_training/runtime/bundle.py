"""A bundle run from image to relevancy."""

import tomllib

import numpy as np

from ..constants import MEAN, STD
from ..samples import images
from .picture import tensor
from .session import session
from .text_encoder import TextEncoder


class Encoders:
    """The graphs encoder.onnx and srd.onnx of a folder: an image uint8 [h, w, 3] -> [h, w, D].

    The manifest is not needed: sizes are in the graphs, the normalisation is that of models/tiny.
    """

    def __init__(self, folder):
        self.encoder, self.srd = session(folder / "encoder.onnx"), session(folder / "srd.onnx")
        self.height, self.width = self.encoder.get_inputs()[0].shape[2:]

    def __call__(self, image):
        x = image
        if x.shape[:2] != (self.height, self.width):
            x = images.resize(x, self.width, self.height, images.BILINEAR)
        x = ((x.transpose(2, 0, 1)[None] - MEAN) / STD).astype(np.float32)
        maps = self.encoder.run(None, {"image": x})
        names = [taken.name for taken in self.srd.get_inputs()]
        return self.srd.run(None, dict(zip(names, maps, strict=True)))[0][0].transpose(1, 2, 0)


class Bundle:
    """The graphs of a bundle, chained as its manifest says."""

    def __init__(self, folder, remember=False):
        """remember: compute the codes of an image only once, as long as the image is kept."""
        self.known = {} if remember else None
        self.manifest = tomllib.loads((folder / "manifest.toml").read_text())
        m = self.manifest
        if "vision" in m:  # one graph from image to codes
            self.vision = session(folder / m["vision"]["file"])
        else:
            self.vision = None
            self.encoder = session(folder / m["encoder"]["file"])
            self.srd = session(folder / m["srd"]["file"])
            self.compress = session(folder / m["compressor"]["encoder"]["file"])
        self.decompress = session(folder / m["compressor"]["decoder"]["file"])
        self.text = TextEncoder(folder, limit=m["text"]["max_tokens"])
        self.negatives = self.text(m["relevancy"]["negatives"])

    def tensor(self, image):
        """An image uint8 [h, w, 3] as the encoder's input, float32 [1, 3, height, width]."""
        return tensor(image, self.manifest["image"])

    def features(self, image):
        """(features decoded from codes, features before), each [h, w, D] of unit length.

        The features before are None if one graph goes from image to codes.
        """
        codes, direct = self.codes(image)
        flat = np.ascontiguousarray(codes.reshape(len(codes), -1).T)
        decoded = self.decompress.run(None, {"codes": flat})[0]
        return decoded.reshape(*codes.shape[1:], -1), direct

    def codes(self, image):
        """(codes [32, h, w], features before as of `features`)."""
        if self.known is None:
            return self.encoded(image)
        if id(image) not in self.known:
            self.known[id(image)] = (image, self.encoded(image)[0])
        return self.known[id(image)][1], None

    def encoded(self, image):
        """`codes`, computed."""
        if self.vision:
            (name,) = (value.name for value in self.vision.get_inputs())
            return self.vision.run(None, {name: self.tensor(image)})[0][0], None
        maps = self.encoder.run(None, {"image": self.tensor(image)})
        inputs = dict(zip(self.manifest["srd"]["inputs"], maps, strict=True))
        features = self.srd.run(None, inputs)[0]
        codes = self.compress.run(None, {"features": features})[0][0]
        return codes, features[0].transpose(1, 2, 0)

    def relevancy(self, features, words):
        """[words, h, w]: the least pairwise softmax of a word against the negatives (section 5)."""
        m = self.manifest["relevancy"]
        logit = m["temperature"] * self.margin(features, words) - m.get("bias", 0.0)
        return 1 / (1 + np.exp(-logit))

    def margin(self, features, words):
        """[words, h, w]: cosine to the word minus the largest cosine to a negative."""
        against = (features @ self.negatives.T).max(-1)
        return (features @ self.text(words).T - against[..., None]).transpose(2, 0, 1)
