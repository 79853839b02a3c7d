"""CLIP transformers exported with dense features, and the compressor that is fitted to them."""

import json

import numpy as np
import pytest
import torch
from PIL import Image

import small
from cosine import least_cosine
from lexsplat_training.export import bundle_writer
from lexsplat_training.export import clip as export_clip
from lexsplat_training.networks import clip_towers, weights
from lexsplat_training.networks.linear_compressor import leading_directions

WORDS = [
    f"{adjective} {noun}"
    for adjective in ("red", "small", "old", "wooden", "wet")
    for noun in ("cup", "sofa", "door", "lamp", "book", "plant", "shoe", "window", "rug")
]


@pytest.fixture(scope="module", autouse=True)
def small_towers():
    patch = pytest.MonkeyPatch()
    patch.setattr(clip_towers, "build", lambda _: small.build(vision=small.VIT))
    yield
    patch.undo()


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Words, photographs and the towers' weights on disk."""
    folder = tmp_path_factory.mktemp("data")
    random = np.random.default_rng(0)
    for at in range(3):
        pixels = random.integers(0, 255, (5, 7, 3), dtype=np.uint8)
        Image.fromarray(pixels).resize((90, 70)).save(folder / f"{at}.png")
    (folder / "words.txt").write_text("\n".join(WORDS))
    (folder / "words.json").write_text(json.dumps([{"name": word} for word in WORDS]))
    torch.save(small.build(vision=small.VIT).state_dict(), folder / "clip.pt")
    return folder


def export(data, out, *more):
    export_clip.main(
        [
            "--model",
            "any",
            "--weights",
            str(data / "clip.pt"),
            "--size",
            "96",
            "128",
            "--out",
            str(out),
            *more,
        ]
    )


def test_attention_of_a_single_token_equals_its_own_value():
    clip = small.build(vision=small.VIT)
    block = clip.visual.transformer.resblocks[-1]
    x = torch.randn(1, 1, 64, generator=torch.Generator().manual_seed(3))
    with torch.inference_mode():
        wanted = block.attn(x, x, x, need_weights=False)[0]
        assert (clip_towers.own_values(block, x) - wanted).abs().max() < 1e-5
        assert (clip_towers.attended(block, x, None) - wanted).abs().max() < 1e-5
        # Negative control: with a second token, attention differs from own values.
        pair = torch.cat([x, -x], 1)
        mixed = block.attn(pair, pair, pair, need_weights=False)[0]
        assert (clip_towers.attended(block, pair, None) - mixed).abs().max() < 1e-5
        assert (clip_towers.own_values(block, pair) - mixed).abs().max() > 1e-2


def test_written_out_attention_equals_open_clips():
    """With plain attention in the last block too, the class token is CLIP's embedding."""
    clip = small.build(vision=small.VIT)
    picture = torch.randn(1, 3, 64, 64, generator=torch.Generator().manual_seed(4))
    dense = clip_towers.VitDense(clip.visual, 64, 64)
    with torch.inference_mode():
        x = clip.visual._embeds(picture)
        for block in clip.visual.transformer.resblocks:
            x = clip_towers.through(block, x, lambda t, b=block: clip_towers.attended(b, t, None))
        pooled = clip.visual.ln_post(x[:, 0]) @ clip.visual.proj
        assert least_cosine(pooled, clip.encode_image(picture)) > 0.99999
        patches = clip.visual.conv1(picture).flatten(2).transpose(1, 2)
        first = clip.visual.class_embedding.expand(1, 1, -1)
        ours = clip.visual.ln_pre(torch.cat([first, patches], 1) + dense.positions)
        assert (ours - clip.visual._embeds(picture)).abs().max() < 1e-5


@pytest.mark.parametrize(("more", "least"), [((), 0.9999), (("--precision", "fp16"), 0.999)])
def test_fitted_bundle_agrees_with_torch(data, tmp_path, more, least):
    words = data / ("words.json" if more else "words.txt")
    export(data, tmp_path, "--words", str(words), "--photos", str(data), *more)
    clip = small.build(vision=small.VIT)
    picture = torch.randn(1, 3, 96, 128, generator=torch.Generator().manual_seed(5))
    with torch.inference_mode():
        features = clip_towers.VitDense(clip.visual, 96, 128)(picture)
    codes = bundle_writer.run(tmp_path, "vision", picture.numpy())
    assert codes.shape == (1, 32, 6, 8)
    rows = codes[0].reshape(32, -1).T
    back = bundle_writer.run(tmp_path, "decompress", np.ascontiguousarray(rows))
    # Codes are the features' coordinates along 32 fitted directions of 128.
    decoder = bundle_writer.run(tmp_path, "decompress", np.eye(32, dtype=np.float32))
    wanted = features[0].flatten(1).T.numpy() @ decoder.T
    assert least_cosine(rows, wanted) > least
    assert least_cosine(back, rows @ decoder) > least
    assert np.abs(decoder @ decoder.T - np.eye(32)).max() < 5e-3
    # Negative control: codes of another picture.
    other = bundle_writer.run(tmp_path, "vision", -picture.numpy())
    assert least_cosine(other[0].reshape(32, -1).T, wanted) < 0.98


def test_fitted_directions_keep_more_than_random_ones():
    random = torch.Generator().manual_seed(6)
    spectrum = 0.85 ** torch.arange(64)
    rows = torch.nn.functional.normalize(torch.randn(500, 64, generator=random) * spectrum + 0.2)

    def kept(directions):
        return (rows @ directions.T).square().sum(1).mean().item()

    fitted = leading_directions([rows])
    arbitrary = torch.linalg.qr(torch.randn(64, 32, generator=random)).Q.T
    assert kept(fitted) > 0.98
    assert kept(arbitrary) < 0.8


def test_errors_name_the_bad_input(data, tmp_path):
    few = tmp_path / "few.txt"
    few.write_text("cup\nsofa\n")
    with pytest.raises(ValueError, match=r"few.txt.*at least 32.*found 2"):
        export(data, tmp_path / "out", "--words", str(few))
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"--photos .*expected JPEG or PNG"):
        export(
            data,
            tmp_path / "out",
            "--words",
            str(data / "words.txt"),
            "--photos",
            str(tmp_path / "empty"),
        )
    with pytest.raises(ValueError, match=r"--size.*multiples of the patch, 16, found 100 128"):
        export(data, tmp_path / "out", "--words", str(data / "words.txt"), "--size", "100", "128")
    state = torch.load(data / "clip.pt", weights_only=True)
    del state["visual.transformer.resblocks.1.ln_2.bias"]
    torch.save(state, tmp_path / "clip.pt")
    with pytest.raises(weights.WeightsError, match=r"resblocks.1.ln_2.bias.*no such tensor"):
        export(tmp_path, tmp_path / "out", "--words", str(data / "words.txt"))
    assert not (tmp_path / "out" / "manifest.toml").exists()


def test_given_compressor_is_used(data, tmp_path):
    _, _, auto_encoder = small.published()
    torch.save(auto_encoder.state_dict(), tmp_path / "ae.pt")
    export(data, tmp_path / "out", "--compressor", str(tmp_path / "ae.pt"))
    codes = torch.randn(4, 32, generator=torch.Generator().manual_seed(7))
    with torch.inference_mode():
        wanted = auto_encoder.decoder(codes)
    found = bundle_writer.run(tmp_path / "out", "decompress", codes.numpy())
    assert least_cosine(found, wanted) > 0.9999
    assert least_cosine(found[::-1], wanted) < 0.999
