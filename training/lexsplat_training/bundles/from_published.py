"""The paper's networks as ONNX graphs; they bring their own compressor."""

from argparse import Namespace

from ..export import bundle_writer, published
from ..export.bundle import Bundle
from ..networks import clip_towers
from ..networks.clip_tokenizer import tokenizer


def convert(entry, files, out):
    """Writes vision.onnx, decompress.onnx, text.onnx and tokenizer.json.

    Returns (Bundle, least cosines).
    """
    size = tuple(entry.options["size"])
    chosen = Namespace(model=entry.options["model"], random=None, **files)
    vision, decoder, text, feature = published.networks(chosen)
    bundle = Bundle(
        name=entry.name,
        licence=entry.licence,
        feature=feature,
        size=size,
        grid=tuple(side // published.STRIDES[1] for side in size),
        mean=clip_towers.MEAN,
        std=clip_towers.STD,
        context=text.context,
    )
    parity = bundle_writer.write(out, bundle, vision, decoder, text, tokenizer(text.context))
    return bundle, parity
