"""What a bundle of large networks consists of, and its manifest."""

from dataclasses import dataclass, field

from ..constants import CODE_SIZE, NEGATIVES
from .manifest import Manifest

PAPER = {"temperature": 10.0, "threshold": 0.5, "negatives": NEGATIVES}  # of the relevancy


@dataclass
class Bundle:
    """How the networks of a bundle are used."""

    name: str
    licence: str
    feature: int
    size: tuple[int, int]  # rows, columns of the image
    grid: tuple[int, int]  # rows, columns of the codes
    mean: tuple[float, ...]  # of images in 0..255
    std: tuple[float, ...]
    context: int  # largest number of text tokens
    channel_order: str = "rgb"
    precision: str = "fp32"
    antialias: bool = False  # whether images are smoothed where they shrink
    folded: bool = True  # one graph from image to codes, otherwise three
    relevancy: dict = field(default_factory=lambda: dict(PAPER))

    @property
    def image(self):
        """The manifest's [image]."""
        return {
            "width": self.size[1],
            "height": self.size[0],
            "fit": "squash",
            "channel_order": self.channel_order,
            "antialias": self.antialias,
            "mean": self.mean,
            "std": self.std,
        }

    @property
    def graphs(self):
        """Names of the image graphs."""
        return ["vision"] if self.folded else ["encoder", "srd", "compress"]

    @property
    def files(self):
        """All files but the manifest."""
        graphs = [*self.graphs, "decompress", "text"]
        return [f"{name}.onnx" for name in graphs] + ["tokenizer.json"]


def manifest(bundle, outputs=()):
    """The bundle's manifest; `outputs`: names of the encoder's outputs if it is not folded."""
    grid = list(bundle.grid)
    compressor = {"decoder": {"file": "decompress.onnx", "input": "codes", "output": "features"}}
    if bundle.folded:
        vision = {"file": "vision.onnx", "input": "image", "output": "codes", "grid": grid}
        graphs = {"vision": vision}
    else:
        encoder = {"file": "encoder.onnx", "input": "image", "outputs": outputs}
        srd = {"file": "srd.onnx", "inputs": outputs, "output": "features", "grid": grid}
        graphs = {"encoder": encoder, "srd": srd}
        compress = {"file": "compress.onnx", "input": "features", "output": "codes"}
        compressor = {"encoder": compress, **compressor}
    return Manifest(
        name=bundle.name,
        version="1",
        licence=bundle.licence,
        feature_size=bundle.feature,
        code_size=CODE_SIZE,
        image=bundle.image,
        graphs=graphs,
        compressor=compressor,
        text={
            "file": "text.onnx",
            "tokenizer": "tokenizer.json",
            "inputs": ["input_ids"],
            "output": "embedding",
            "max_tokens": bundle.context,
        },
        relevancy=bundle.relevancy,
    )
