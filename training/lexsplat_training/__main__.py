"""The commands: `python -m lexsplat_training COMMAND ...`."""

import importlib
import sys

from .command_line import InputError

# command: (module with main(arguments), what it does)
COMMANDS = {
    "furnish": ("scenes.furnish", "render labelled frames of furnished rooms"),
    "export-text": ("export.text", "export the sentence encoder as the text tower"),
    "train-encoder": ("train.encoder", "train the image encoder and the decoder behind it"),
    "train-head": ("train.head", "train the head of the second image encoder"),
    "average-weights": ("train.average", "average the weights of several training runs"),
    "train-compressor": ("train.compressor", "train the compressor from features to codes"),
    "join-encoders": ("export.pair", "join two image encoders to one"),
    "export-tiny": ("export.tiny", "assemble the bundle models/tiny"),
    "bundle": ("bundles.command", "make a bundle of published networks from a hub"),
    "export-published": ("export.published", "export the paper's networks as a bundle"),
    "export-clip": ("export.clip", "export a CLIP vision transformer as a bundle"),
    "fold-bundle": ("export.folding", "fold a bundle's three image graphs into one"),
    "evaluate": ("measure.evaluate", "score a bundle on labelled frames"),
    "golden": ("measure.golden", "write the renderer's reference pictures with gsplat"),
    "plot-codes": ("measure.plot_codes", "plot how well codes stay readable"),
}
USAGE = "usage: python -m lexsplat_training COMMAND ...  (COMMAND --help explains its arguments)"


def main():
    """Runs the command that the command line names."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name in ("-h", "--help"):
        print(USAGE, "", *(f"  {key:18}{text}" for key, (_, text) in COMMANDS.items()), sep="\n")
        return
    if name not in COMMANDS:
        sys.exit(f"error: no command {name!r}; there are {', '.join(COMMANDS)}")
    module = importlib.import_module(f"lexsplat_training.{COMMANDS[name][0]}")
    try:
        module.main(arguments)
    except InputError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
