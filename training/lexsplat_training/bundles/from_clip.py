"""A CLIP vision transformer of open_clip as ONNX graphs with a feature for each patch."""

from ..export import bundle_writer
from ..export.bundle import Bundle
from ..networks import clip_towers, weights
from ..networks.clip_tokenizer import tokenizer


def convert(entry, files, out):
    """Writes features.onnx, text.onnx and tokenizer.json; returns (Bundle, least cosines)."""
    size = tuple(entry.options["size"])
    clip = weights.load(clip_towers.build(entry.options["model"]), files["weights"], "towers")
    encoder = clip_towers.VitDense(clip.visual, *size).eval()
    text = clip_towers.TextTower(clip).eval()
    parity = bundle_writer.write_towers(out, encoder, text, tokenizer(text.context), size)
    return Bundle(
        name=entry.name,
        licence=entry.licence,
        feature=clip.visual.proj.shape[1],
        size=size,
        grid=encoder.grid,
        mean=clip_towers.MEAN,
        std=clip_towers.STD,
        context=text.context,
        antialias=True,
    ), parity
