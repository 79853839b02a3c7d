"""Writes the files of every bundle of the catalogue with random weights, for a hub on loopback.

By hand, at full size: `PYTHONPATH=. python tests/random_hub.py FOLDER NAME...`, then
`python tests/hub.py FOLDER`.
"""

import sys
from pathlib import Path

import open_clip
import timm
import torch
from safetensors.torch import save_file
from tokenizers import Tokenizer, models, pre_tokenizers, processors
from torch import nn

import small
from lexsplat_training.bundles import catalogue
from lexsplat_training.export import graphs
from lexsplat_training.networks import clip_towers, talk2dino
from lexsplat_training.networks.published import AutoEncoder, SuperResolution
from lexsplat_training.networks.random_weights import calibrated, scattered

SIGLIP = {"image": (96, 96), "patch": 16, "width": 64, "layers": 2, "words": 300}
SIGLIP_FULL = {"image": (512, 512), "patch": 16, "width": 768, "layers": 12, "words": 256_000}
TOKENS = 64


def write(folder, entry, full=False):
    """Writes the files of an entry below `folder` as a hub serves them."""
    places = {}
    for role, source in entry.files.items():
        places[role] = folder / source.repo / source.names[0]
        places[role].parent.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    WRITERS[entry.convert](places, entry.options, full)


def clip(places, options, full):
    """An OpenCLIP vision transformer."""
    network = clip_towers.build(options["model"]) if full else small.build(vision=small.VIT)
    save_file(contiguous(scattered(network)), places["weights"])


def published(places, options, full):
    """The paper's files, with prefixes and in nested dictionaries as they are published."""
    if full:
        network = scattered(clip_towers.build(options["model"]))
        encoder = clip_towers.ConvNextDense(network.visual)
        srd, auto_encoder = SuperResolution(768, encoder.skips), AutoEncoder(768)
        calibrated(encoder, scattered(srd), scattered(auto_encoder))
    else:
        network, srd, auto_encoder = small.published()
    image = small.prefixed("visual.", network.visual)
    image = {f"sem_seg_head.predictor.clip_model.{name}": one for name, one in image.items()}
    torch.save({"model": image, "iteration": 79999}, places["image"])
    save_file(contiguous(network), places["text"])
    torch.save({"state_dict": small.prefixed("model.", srd)}, places["srd"])
    torch.save({"state_dict": small.prefixed("model.", auto_encoder)}, places["compressor"])


def talk2dino_file(places, options, full):
    """DINOv2 under its own names, both towers of CLIP in half precision, and the mapping."""
    if full:
        vision, network = talk2dino.build(options["model"], options["text"], (518, 518))
    else:
        vision, network = small_talk2dino(None, None, (70, 70))
    text = clip_towers.TextTower(network)
    mapping = talk2dino.Mapping(clip_towers.width(text), vision.embed_dim)
    tensors = {f"model.{name}": one for name, one in dinov2(scattered(vision)).items()}
    tensors |= small.prefixed("clip_model.", scattered(network).half())
    tensors |= small.prefixed("proj.", scattered(mapping))
    save_file({name: one.clone().contiguous() for name, one in tensors.items()}, places["weights"])


def small_talk2dino(_model, _text, size):
    """A small DINOv2 of timm with registers, and a small CLIP."""
    vision = timm.create_model(
        "vit_base_patch14_reg4_dinov2",
        pretrained=False,
        num_classes=0,
        img_size=tuple(size),
        embed_dim=64,
        depth=3,
        num_heads=4,
    )
    return vision.eval(), small.build(vision=small.VIT)


def dinov2(vision):
    """A DINOv2 of timm under the names of its authors: the class token has a position, too."""
    tensors = dict(vision.state_dict())
    tensors["register_tokens"] = tensors.pop("reg_token")
    tensors["mask_token"] = torch.zeros(1, vision.embed_dim)
    first = torch.randn(1, 1, vision.embed_dim)
    tensors["cls_token"] = tensors["cls_token"] - first
    tensors["pos_embed"] = torch.cat([first, tensors["pos_embed"]], 1)
    return tensors


class SiglipVision(nn.Module):
    """SigLIP's image tower as it is exported: patches, and the head's result."""

    def __init__(self, trunk):
        super().__init__()
        self.trunk = trunk

    def forward(self, pixels):
        patches = self.trunk.forward_features(pixels)
        return patches, self.trunk.forward_head(patches)


class SiglipText(nn.Module):
    """SigLIP's text tower as it is exported: tokens, and the last token projected."""

    def __init__(self, text):
        super().__init__()
        self.text = text

    def forward(self, ids):
        x = self.text.token_embedding(ids) + self.text.positional_embedding[: ids.shape[1]]
        for block in self.text.transformer.resblocks:
            x = clip_towers.through(
                block, x, lambda tokens, block=block: clip_towers.attended(block, tokens, None)
            )
        x = self.text.ln_final(x)
        return x, self.text.text_projection(x[:, -1])


def siglip(size):
    """(image tower, text tower) of SigLIP, of `size`."""
    heads = max(1, size["width"] // 64) if size["width"] > 64 else 4
    trunk = timm.create_model(
        "vit_base_patch16_siglip_512",
        pretrained=False,
        num_classes=0,
        img_size=size["image"],
        embed_dim=size["width"],
        depth=size["layers"],
        num_heads=heads,
    )
    text = open_clip.transformer.TextTransformer(
        context_length=TOKENS,
        vocab_size=size["words"],
        width=size["width"],
        heads=heads,
        layers=size["layers"],
        output_dim=size["width"],
        no_causal_mask=True,
        proj_bias=True,
        pool_type="last",
    )
    return SiglipVision(scattered(trunk)).eval(), SiglipText(scattered(text)).eval()


def siglip_files(places, _options, full):
    """SigLIP's towers as ONNX, and a tokenizer with its special tokens."""
    size = SIGLIP_FULL if full else SIGLIP
    vision, text = siglip(size)
    outputs = ["last_hidden_state", "pooler_output"]
    free = {0: "batch"}
    export(
        vision, torch.zeros(1, 3, *size["image"]), "pixel_values", outputs, free, places["vision"]
    )
    ids = torch.ones(1, TOKENS, dtype=torch.int64)
    export(text, ids, "input_ids", outputs, free, places["text"])
    places["tokenizer"].write_text(siglip_tokenizer(size["words"]).to_str())


def export(module, example, given, outputs, free, path):
    """One tower of SigLIP as ONNX, for any number of images or texts."""
    with torch.inference_mode():
        graphs.write(
            module, path, (example,), [given], outputs, dict.fromkeys([given, *outputs], free)
        )


def siglip_tokenizer(words):
    """A tokenizer of words with <pad> as 0 and <eos> at the end, which knows lower case only."""
    known = ["<pad>", "<eos>", "<unk>", "cup", "sofa", "chair", "floor", "wall", "lamp", "bed"]
    ids = {word: at for at, word in enumerate(known[:words])}
    made = Tokenizer(models.WordLevel(ids, unk_token="<unk>"))
    made.pre_tokenizer = pre_tokenizers.Whitespace()
    made.post_processor = processors.TemplateProcessing(
        single="$A <eos>", special_tokens=[("<eos>", 1)]
    )
    return made


def contiguous(module):
    """A module's tensors as safetensors wants them."""
    return {name: one.clone().contiguous() for name, one in module.state_dict().items()}


WRITERS = {
    "clip": clip,
    "published": published,
    "siglip": siglip_files,
    "talk2dino": talk2dino_file,
}

if __name__ == "__main__":
    for chosen in sys.argv[2:]:
        write(Path(sys.argv[1]), catalogue.entry(chosen), full=True)
        print(f"wrote the files of {chosen}", flush=True)
