"""Fits a bundle to rendered rooms: the compressor, the scale of the relevancy, the confidence.

Runs the exported graphs only, so that all kinds of bundles are fitted alike.
"""

from pathlib import Path

import numpy as np
import onnx

from ..command_line import InputError
from ..constants import CODE_SIZE, NEGATIVES
from ..export import surgery
from ..measure import calibration
from ..runtime.bundle import Bundle
from ..runtime.picture import tensor
from ..runtime.session import session
from ..runtime.text_encoder import TextEncoder

WORDS = Path(__file__).with_name("words.txt")
PER_FRAME = 200  # patches used of each frame
STEEPEST = 100.0  # of the confidence
TEMPERATURES = (1.0, 1000.0)  # that are believed; others say that words are not found at all


def compressor(out, bundle, frames, words):
    """Writes vision.onnx and decompress.onnx in place of features.onnx.

    Fitted to patches of labelled frames and to words. Returns the mean cosine of patches and of
    words to themselves decoded from codes, by name, and the frames' codes as `Bundle.known`.
    """
    names = sorted({name for *_, names in frames for name in names})
    text = TextEncoder(out, limit=bundle.context)
    run = session(out / "features.onnx")
    every = [run.run(None, {"image": tensor(rgb, bundle.image)})[0][0] for rgb, *_ in frames]
    sources = {
        "patches": patches(every),
        "words": text([*dict.fromkeys([*words, *names, *NEGATIVES])]),
    }
    directions = leading_directions(sources.values())
    model = surgery.compressed(onnx.load(out / "features.onnx"), directions)
    onnx.save(model, out / "vision.onnx")
    onnx.save(surgery.decompressor(directions), out / "decompress.onnx")
    (out / "features.onnx").unlink()
    kept = {}
    for name, rows in sources.items():
        decoded = rows @ directions.T @ directions
        length = np.linalg.norm(decoded, axis=1).clip(1e-12)
        kept[name] = float(((decoded * rows).sum(1) / length).mean())
    codes = (np.tensordot(directions, features, 1) for features in every)
    known = {
        id(rgb): (rgb, one / np.linalg.norm(one, axis=0).clip(1e-12))
        for (rgb, *_), one in zip(frames, codes, strict=True)
    }
    return kept, known


def patches(every):
    """PER_FRAME random patches of each frame's features [D, h, w]: [n, D]."""
    random, rows = np.random.default_rng(0), []
    for features in every:
        flat = features.reshape(len(features), -1).T
        rows.append(flat[random.permutation(len(flat))[:PER_FRAME]])
    return np.concatenate(rows)


def leading_directions(sources):
    """The CODE_SIZE orthonormal directions that keep most of unit rows: [CODE_SIZE, D].

    Every source counts the same; moments are taken about zero (as `networks.linear_compressor`).
    """
    moments = sum(rows.T.astype(np.float64) @ rows / len(rows) for rows in sources)
    _, vectors = np.linalg.eigh(moments)
    if len(vectors) < CODE_SIZE:
        raise InputError(f"features: expected at least {CODE_SIZE} channels, found {len(vectors)}")
    return vectors.T[::-1][:CODE_SIZE].astype(np.float32)


def scales(out, description, frames, known, least):
    """Fits temperature, bias and confidence; returns the manifest's [relevancy].

    The threshold stays 0.5: the bias is the one with the best IoU there. known: codes of frames.
    """
    bundle = Bundle(out, remember=True)
    bundle.known.update(known)
    found = calibration.relevancy(bundle, frames, least)
    lowest, highest = TEMPERATURES
    believed = lowest <= found.temperature <= highest
    temperature = found.temperature if believed else description.relevancy["temperature"]
    scale = {
        **description.relevancy,
        "temperature": round(float(temperature), 3),
        "bias": round(float(temperature * found.margin), 3),
    }
    bundle.manifest["relevancy"] = scale
    steepness, offset = calibration.logistic(*calibration.peaks(bundle, frames, least))
    if steepness > 0:
        scale["present_threshold"] = round(float(np.clip(offset / steepness, 0, 1)), 3)
        scale["confidence_steepness"] = round(float(min(steepness, STEEPEST)), 1)
    if not believed or steepness <= 0:
        print("warning: words are not found in the rendered rooms; the scales were not fitted")
    return scale
