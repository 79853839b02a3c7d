"""Make a bundle of published networks: download, convert, fit, score.

The catalogue (bundles/catalogue.toml) has the names. Files come from a hub, are pinned by the lock
file and kept, so that the command can be run again after it was stopped. The graphs are compared
with what they were converted from, the compressor and the scales are fitted to rendered rooms, and
the bundle is scored on other rooms beside models/tiny. The folder appears when all is done, with a
model card as README.md.
"""

import importlib
import shutil
import time
from pathlib import Path

from ..command_line import parser
from ..constants import CODE_SIZE
from ..export.bundle import manifest
from ..measure.calibration import labelled
from . import card, catalogue, files, fit, licence, rooms, score
from .hub import HUB
from .lock import Lock

EXAMPLE = "siglip2 --accept-licence"
ROOT = Path(__file__).parents[3]
TINY = ROOT / "models" / "tiny"


def make(entry, args):
    """Makes the bundle of an entry; returns its folder."""
    downloads, lock = args.cache / entry.name, Lock(args.lock)
    say(1, f"download {entry.name} from {args.hub} into {downloads}")
    sources = files.gather(entry, args.hub, downloads, lock)
    say(2, "render rooms")
    seen = rooms.render(args.lexsplat, args.cache)
    out = args.out or ROOT / "models" / entry.name
    unfinished = out.with_name(f"{out.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    say(3, "convert, and compare with what it was converted from")
    converter = importlib.import_module(f"lexsplat_training.bundles.from_{entry.convert}")
    bundle, parity = converter.convert(entry, sources, unfinished)
    say(4, "fit to rendered rooms")
    frames, kept, known = labelled(seen.fitted), {}, {}
    if (unfinished / "features.onnx").exists():
        words = args.words.read_text().split("\n")
        words = [word.strip() for word in words if word.strip()]
        kept, known = fit.compressor(unfinished, bundle, frames, words)
        shown = ", ".join(f"{name} {value:.3f}" for name, value in kept.items())
        print(f"compressor to {CODE_SIZE} numbers: mean cosine of what it keeps: {shown}")
    manifest(bundle).write(unfinished, bundle.files)
    bundle.relevancy = fit.scales(unfinished, bundle, frames, known, rooms.LEAST)
    manifest(bundle).write(unfinished, bundle.files)
    say(5, "score on other rooms")
    frames = labelled(seen.scored)
    folders = {entry.name: unfinished, "tiny": TINY}
    scores = {name: score.score(folder, frames, rooms.LEAST) for name, folder in folders.items()}
    print(card.table(scores))
    locked = {role: lock.find(entry.name, role) for role in entry.files}
    made = card.Made(entry, args.hub, locked, parity, kept, bundle.relevancy, scores)
    card.write(made, unfinished / "README.md")
    shutil.rmtree(out, ignore_errors=True)
    unfinished.replace(out)
    return out


def say(step, text):
    """Prints the heading of a step."""
    print(f"[{step}/5] {text}", flush=True)


def arguments_parser():
    arguments = parser("bundle", __doc__, EXAMPLE)
    add = arguments.add_argument
    add("name", help=", ".join(catalogue.read()))
    add("--hub", default=HUB, help=f"the hub or a mirror of it (default {HUB})")
    add("--accept-licence", action="store_true", help="do not ask whether it is accepted")
    add("--ask-only", action="store_true", help="ask for the licence, do nothing else")
    add("--packages", action="store_true", help="print the file of requirements, do nothing else")
    add("--words", type=Path, default=fit.WORDS, help="one a line, for the compressor")
    add(
        "--lexsplat",
        type=Path,
        default=ROOT / "target/debug/lexsplat",
        help="the program that renders rooms (default target/debug/lexsplat)",
    )
    add(
        "--cache",
        type=Path,
        default=ROOT / ".deps/bundles",
        help="folder for downloads and rooms, which may be deleted (default .deps/bundles)",
    )
    add("--lock", type=Path, default=ROOT / "training/bundles.lock", help="the lock file")
    add("--out", type=Path, help="folder of the bundle (default models/NAME)")
    return arguments


def main(arguments=None):
    args = arguments_parser().parse_args(arguments)
    entry = catalogue.entry(args.name)
    if args.packages:
        print(entry.packages)
        return
    licence.ask(entry, args.accept_licence)
    if args.ask_only:
        return
    args.hub = args.hub.rstrip("/")
    started = time.time()
    out = make(entry, args)
    size = sum(file.stat().st_size for file in out.iterdir()) / 1e9
    print(f"{out}: {size:.2f} GB, made in {time.time() - started:.0f} s; its card is README.md")
    server = args.lexsplat.with_name("lexsplat-server")
    print(f"Start the server with it:\n  {server} --models {out}")
