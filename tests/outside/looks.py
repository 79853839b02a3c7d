#!/usr/bin/env python3
"""Looks at the dashboard in Chromium and compares what it sees with the pictures in looks/.

    looks.py http://127.0.0.1:8080/ CHROMIUM FOLDER

The server has no map. Once the file FOLDER/more is there, somebody sends a walk through a room to
the map "room". For each screenshot target/looks/ gets a picture: the reference, what was seen, and
where they differ. With LOOKS=keep (make looks) the screenshots become the references.

Other fonts, drivers and maps of the same room change details, a broken page changes regions. So a
picture is compared in blocks of 32 pixels of the screen, by their mean color and by their contrast,
which tells text from nothing whatever the font. The difference of two pictures is that of the
region of 5 x 5 blocks that differs most, in shades of 0 to 255.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
from page import TIMEOUT_MS, ask, settles, wait
from PIL import Image
from playwright.sync_api import Page, expect, sync_playwright
from space import SOFTWARE, scene, splats

ROOT = Path(__file__).parents[2]
REFERENCES = Path(__file__).parent / "looks"
FOLDER = ROOT / "target/looks"
# Pixels of the screen for one of a reference, and pixels of a reference in a block.
SHRINK, BLOCK = 4, 8
# How many times the contrast of a block counts as much as its color.
CONTRAST = 2
REGION = 5
# Measured: on llvmpipe up to 4.2, on SwiftShader 5.5, with another font 5.5, with a blurred picture
# 9.5. The broken pages below: 17.3 (without its controls, on SwiftShader) and more.
MOST = 12
LAPTOP, PHONE, WIDE = (1280, 800), (390, 844), (2200, 1200)
# Over the table, towards the door: mode, eye, yaw, pitch, distance.
CAMERA = "orbit_-0.6_1.63_1.47_-0.43_-0.27_4.2"


def blocks(picture: Image.Image) -> np.ndarray:
    """Mean red, green, blue and contrast of each block, smoothed: (rows, columns, 4)."""
    rows, columns = picture.height // BLOCK, picture.width // BLOCK
    pixels = np.asarray(picture.convert("RGB"), float)[: rows * BLOCK, : columns * BLOCK]
    parts = pixels.reshape(rows, BLOCK, columns, BLOCK, 3)
    contrast = CONTRAST * parts.mean(axis=4).std(axis=(1, 3))
    found = np.concatenate([parts.mean(axis=(1, 3)), contrast[..., None]], axis=2)
    return windows(found, 3).mean(axis=(3, 4))


def windows(values: np.ndarray, size: int) -> np.ndarray:
    """Every square of `size` x `size` of the first two axes."""
    return np.lib.stride_tricks.sliding_window_view(values, (size, size), axis=(0, 1))


def differences(a: Image.Image, b: Image.Image) -> np.ndarray:
    """The difference of each region; pictures of different sizes differ in everything."""
    if a.size != b.size:
        return np.full((1, 1), 255.0)
    return windows(np.abs(blocks(a) - blocks(b)).max(axis=2), REGION).mean(axis=(2, 3))


def screenshot(page: Page) -> Image.Image:
    loaded = "[...document.querySelectorAll('#strip img')].every((image) => image.complete)"
    wait(page, "pictures of keyframes", lambda: page.evaluate(loaded))
    picture = Image.open(BytesIO(page.screenshot())).convert("RGB")
    return picture.reduce(SHRINK)


def explain(now: Image.Image, reference: Image.Image) -> Image.Image:
    """The reference, what is seen now, and where they differ."""
    found = np.clip(differences(now, reference) * 255 / (2 * MOST), 0, 255).astype(np.uint8)
    where = Image.fromarray(found).resize(now.size, Image.Resampling.NEAREST)
    sheet = Image.new("RGB", (3 * now.width, max(now.height, reference.height)))
    for at, part in enumerate((reference, now, where)):
        sheet.paste(part, (at * now.width, 0))
    return sheet


class Looks:
    """Compares pages with their references, and says what came of it."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.keeps = os.environ.get("LOOKS") == "keep"
        self.wrong: list[str] = []
        FOLDER.mkdir(parents=True, exist_ok=True)
        for old in FOLDER.glob("*.png"):
            old.unlink()

    def like(self, name: str) -> None:
        """The page looks as in a reference."""
        now = screenshot(self.page)
        file = REFERENCES / f"{name}.jpg"
        if self.keeps:
            REFERENCES.mkdir(exist_ok=True)
            now.save(file, quality=80, optimize=True)
        if not file.exists():
            self.wrong.append(f"{name}: there is no reference: make looks")
            return
        self.compare(name, now, "as it is", passes=True)

    def compare(self, name: str, now: Image.Image, what: str, passes: bool) -> None:
        reference = Image.open(REFERENCES / f"{name}.jpg").convert("RGB")
        found = float(differences(now, reference).max())
        print(f"{name}, {what}: {found:.1f}")
        explain(now, reference).save(FOLDER / f"{name}, {what}.png")
        if (found <= MOST) != passes:
            should = "at most" if passes else "more than"
            self.wrong.append(f"{name}, {what}: {found:.1f}, {should} {MOST} was expected")

    def but(self, name: str, changes: dict[str, str], passes: bool = False) -> None:
        """With each of these style sheets added, the page looks otherwise, or still the same."""
        for what, sheet in changes.items():
            with styled(self.page, sheet):
                self.compare(name, screenshot(self.page), what, passes)


@contextmanager
def styled(page: Page, sheet: str) -> Iterator[None]:
    """The page with one more style sheet; an empty one: without its own."""
    page.evaluate(
        """(text) => {
          const sheet = new CSSStyleSheet();
          sheet.replaceSync(text);
          document.adoptedStyleSheets = [document.adoptedStyleSheets[0], sheet];
          for (const own of document.styleSheets) own.disabled = text === '';
        }""",
        sheet,
    )
    page.wait_for_timeout(100)
    try:
        yield
    finally:
        page.evaluate(
            """() => {
              document.adoptedStyleSheets = [document.adoptedStyleSheets[0]];
              for (const own of document.styleSheets) own.disabled = false;
            }"""
        )
        page.wait_for_timeout(100)


# Lines break at the same places on other machines.
FONT = """
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(":root { font-family: 'DejaVu Sans', sans-serif; }");
  document.adoptedStyleSheets = [sheet];
"""
# Style sheets that change details only, and such that break the page.
SAME = {
    "another font": "* { font-family: 'DejaVu Serif', serif !important; }",
    "a blurred picture": "#picture, #scene { filter: blur(1.5px) brightness(.97); }",
}
BROKEN = {
    "without its style": "",
    "without its answer": "aside section:nth-child(1) { visibility: hidden; }",
    "without its objects": "aside section:nth-child(2) { visibility: hidden; }",
    "without its plan": "#plan { visibility: hidden; }",
    "without its controls": ".controls { visibility: hidden; }",
    "without its keyframes": "#strip { visibility: hidden; }",
    "without its header": "header { display: none; }",
    "in one column": "main { display: block; }",
}
BROKEN_PICTURE = {
    "picture not drawn": "#picture, #scene { visibility: hidden; }",
    "picture upside down": "#picture, #scene { transform: scaleY(-1); }",
    "picture mirrored": "#picture, #scene { transform: scaleX(-1); }",
    "picture too small": "#picture, #scene { transform: scale(.6); }",
}


def opens(page: Page, address: str) -> None:
    """A new page: in one that only gets another address, parts would come one after the other."""
    page.goto("about:blank")
    page.goto(address)
    expect(page.locator("#timeline")).to_be_visible(timeout=TIMEOUT_MS)
    expect(page.locator("#timeline-text")).to_contain_text("24 frames", timeout=TIMEOUT_MS)
    settles(page)


def shows_fixed(page: Page, address: str) -> None:
    opens(page, f"{address}#map=room&channel=color")
    ask(page, "wall")
    expect(page.locator("#answer .verdict")).to_contain_text("wall", timeout=TIMEOUT_MS)
    page.wait_for_timeout(500)


def shows_space(page: Page, address: str) -> None:
    opens(page, f"{address}#map=room&ask=wall&camera={CAMERA}")
    wait(page, "splats", lambda: splats(page) > 0)
    expect(page.locator("#answer .verdict")).to_contain_text("wall", timeout=TIMEOUT_MS)
    scene(page)


def resize(page: Page, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.wait_for_timeout(300)
    if page.locator("#space").is_visible():
        scene(page)


def looks(page: Page, address: str, folder: Path) -> list[str]:
    look = Looks(page)
    page.goto(address)
    expect(page.locator("#empty")).to_be_visible(timeout=TIMEOUT_MS)
    look.like("empty")
    look.but("empty", {"without its style": "", "without its text": "#empty { display: none; }"})
    (folder / "more").touch()
    expect(page.locator("#maps option")).to_have_count(1, timeout=TIMEOUT_MS)

    shows_fixed(page, address)
    for theme, other in (("dark", "light"), ("light", "dark")):
        page.emulate_media(color_scheme=theme)
        page.wait_for_timeout(200)
        look.like(f"fixed-{theme}")
        look.but(f"fixed-{theme}", SAME, passes=True)
        look.but(f"fixed-{theme}", BROKEN | BROKEN_PICTURE)
        page.emulate_media(color_scheme=other)
        page.wait_for_timeout(200)
        look.compare(f"fixed-{theme}", screenshot(page), f"{other} instead", passes=False)
    page.emulate_media(color_scheme="dark")

    resize(page, PHONE)
    look.like("fixed-phone")
    look.but("fixed-phone", SAME, passes=True)
    shows_space(page, address)
    for name, size in (("space-phone", PHONE), ("space-dark", LAPTOP), ("space-wide", WIDE)):
        resize(page, size)
        look.like(name)
        look.but(name, SAME, passes=True)
        look.but(name, BROKEN_PICTURE)
    return look.wrong


def main() -> None:
    address, chromium, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    with sync_playwright() as playwright:
        launch = playwright.chromium.launch
        browser = launch(executable_path=chromium, args=["--no-sandbox", *SOFTWARE])
        page = browser.new_page(viewport={"width": LAPTOP[0], "height": LAPTOP[1]})
        page.emulate_media(color_scheme="dark", reduced_motion="reduce")
        page.add_init_script(FONT)
        wrong = looks(page, address, folder)
        browser.close()
    if wrong:
        sys.exit("\n".join([*wrong, f"the pictures are in {FOLDER}"]))
    print("all looks are right")


if __name__ == "__main__":
    main()
