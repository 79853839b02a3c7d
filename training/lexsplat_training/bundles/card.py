"""A bundle's model card: where it comes from, how it was fitted, how it scores."""

from dataclasses import dataclass

from .catalogue import Entry
from .lock import Locked
from .score import Score

HEAD = (
    "| bundle | Loc | IoU | chance | order | right | s a frame |\n|---|---|---|---|---|---|---|\n"
)


@dataclass
class Made:
    """What is known of a bundle when it is finished."""

    entry: Entry
    hub: str
    files: dict[str, Locked]
    parity: dict[str, float]  # least cosine of each graph to what it was converted from
    kept: dict[str, float]  # mean cosine of patches and words to themselves decoded from codes
    relevancy: dict
    scores: dict[str, Score]  # by the bundle's name


def table(scores):
    """The scores of bundles as a table of Markdown."""
    return HEAD + "".join(
        f"| {name} | {one.loc:.2f} | {one.iou:.2f} | {one.chance:.2f} | {one.order:.2f} "
        f"| {one.right:.2f} | {one.seconds:.2f} |\n"
        for name, one in scores.items()
    )


def write(made, path):
    """Writes the model card."""
    entry, own = made.entry, made.scores[made.entry.name]
    sources = "".join(
        f"| {one.path} | {one.repo or 'by hand'} | {one.revision[:12]} | {one.sha256} |\n"
        for one in made.files.values()
    )
    parity = ", ".join(f"{name} {value:.6f}" for name, value in made.parity.items())
    kept = ", ".join(f"{name} {value:.3f}" for name, value in made.kept.items())
    scale = ", ".join(f"{key} {value}" for key, value in made.relevancy.items())
    words = "".join(
        f"| {word} | {frames} | {loc:.2f} | {iou:.2f} |\n"
        for word, (frames, loc, iou) in own.words.items()
    )
    path.write_text(f"""\
# The bundle `{entry.name}`

{entry.title}. Made by `make bundle NAME={entry.name}` from files of {made.hub}.

**Licence: {entry.licence}.** {entry.terms} {entry.page}

| file | repository | revision | SHA-256 |
|---|---|---|---|
{sources}
Least cosine of the ONNX graphs to the networks that they were converted from: {parity}.

Compressor: {kept or "brought along"} (mean cosine to themselves decoded from 32 numbers).

Relevancy, fitted to rendered rooms: {scale}.

## Scores

Rendered rooms that it was not fitted to, each frame alone, without a map, mean over words. *Loc*:
the peak of the relevancy lies in the object. *IoU*: at the threshold. *Order*: a word that is there
scores more than one that is not. *Right*: whether it is there is answered rightly, both answers of
equal weight. `tiny` was trained on other rooms of the same generator, so that these rooms favour
it; they say nothing of cameras.

{table(made.scores)}
| word | frames | Loc | IoU |
|---|---|---|---|
{words}""")
