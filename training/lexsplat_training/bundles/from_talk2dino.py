"""Talk2DINO as ONNX graphs: DINOv2's patches, and texts mapped to them."""

from ..export import bundle_writer
from ..export.bundle import Bundle
from ..networks import talk2dino
from ..networks.clip_tokenizer import tokenizer


def convert(entry, files, out):
    """Writes features.onnx, text.onnx and tokenizer.json; returns (Bundle, least cosines)."""
    size = tuple(entry.options["size"])
    vision, clip = talk2dino.build(entry.options["model"], entry.options["text"], size)
    encoder, text = talk2dino.load(vision, clip, files["weights"])
    parity = bundle_writer.write_towers(out, encoder, text, tokenizer(text.context), size)
    return Bundle(
        name=entry.name,
        licence=entry.licence,
        feature=vision.embed_dim,
        size=size,
        grid=encoder.grid,
        mean=talk2dino.MEAN,
        std=talk2dino.STD,
        context=text.context,
        antialias=True,
    ), parity
