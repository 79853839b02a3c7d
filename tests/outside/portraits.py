#!/usr/bin/env python3
"""Takes the pictures of the dashboard that the README shows, of a map that a server has.

    portraits.py http://127.0.0.1:8080/ CHROMIUM living

The map should be of the data set house-living, whose things are asked for.
"""

import sys
from io import BytesIO
from pathlib import Path

from page import TIMEOUT_MS, ask, settles, wait
from PIL import Image
from playwright.sync_api import Browser, expect, sync_playwright
from space import SOFTWARE, scene, splats

ROOT = Path(__file__).parents[2]
# File, size of the screen, its pixels for a pixel of the page, theme, width of the picture, and
# what the address asks for.
PORTRAITS = (
    ("dashboard", (1280, 800), 1, "dark", 1280, "ask=coffee table"),
    ("dashboard-phone", (390, 844), 2, "dark", 585, "ask=television&channel=color"),
    ("dashboard-wide", (2200, 1200), 1, "light", 1650, "ask=sofa, rug, coffee table, floor"),
)


def portrait(browser: Browser, address: str, name: str, width: int, **screen: object) -> None:
    page = browser.new_page(**screen)
    page.goto(address)
    answer = page.locator("#answer .verdict, #answer .legend").first
    expect(answer).to_be_visible(timeout=TIMEOUT_MS)
    expect(page.locator("#timeline")).to_be_visible(timeout=TIMEOUT_MS)
    settles(page)
    if page.locator("#space").is_visible():
        wait(page, "splats", lambda: splats(page) > 0)
        scene(page)
    page.wait_for_timeout(2000)
    # Once more, while nothing else keeps the machine busy: the answer says how long it took.
    ask(page, page.input_value("#text"))
    page.evaluate("document.activeElement.blur()")
    page.wait_for_timeout(2000)
    picture = Image.open(BytesIO(page.screenshot())).convert("RGB")
    size = (width, round(picture.height * width / picture.width))
    file = ROOT / f"{name}.jpg"
    picture.resize(size, Image.Resampling.LANCZOS).save(file, quality=82, optimize=True)
    print(f"{file.name}: {size[0]} x {size[1]}, {file.stat().st_size // 1000} kB")
    page.close()


def main() -> None:
    address, chromium, map_name = sys.argv[1:4]
    with sync_playwright() as playwright:
        launch = playwright.chromium.launch
        browser = launch(executable_path=chromium, args=["--no-sandbox", *SOFTWARE])
        for name, (across, down), sharp, theme, width, asked in PORTRAITS:
            screen = {
                "viewport": {"width": across, "height": down},
                "device_scale_factor": sharp,
                "color_scheme": theme,
            }
            portrait(browser, f"{address}#map={map_name}&{asked}", name, width, **screen)
        browser.close()


if __name__ == "__main__":
    main()
