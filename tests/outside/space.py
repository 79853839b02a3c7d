#!/usr/bin/env python3
"""Uses the 3D view of the dashboard in Chromium, as a person does.

    space.py http://127.0.0.1:8080/ CHROMIUM FOLDER

The server has the maps "room" and "empty". Once the file FOLDER/more is there, somebody sends more
frames to "room". Screenshots are left in FOLDER.
"""

import base64
import math
import struct
import sys
from pathlib import Path

from page import HINT, TIMEOUT_MS, ask, ink, settles, wait
from playwright.sync_api import Page, expect, sync_playwright
from touch import is_touched

# WebGL2 without a graphics card.
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
# Vertical field of view of the 3D view where it is as wide as 4:3, degrees.
FIELD = 55
# Shades, 32 x 24, of the middle of a picture: `share` of its height, and as much across.
SHADES = """async ([source, share]) => {
  const image = new Image();
  image.src = source;
  await image.decode();
  const [width, height] = [image.width, image.height];
  const tall = share * height, wide = tall * 4 / 3;
  const canvas = Object.assign(document.createElement('canvas'), { width: 32, height: 24 });
  const context = canvas.getContext('2d');
  context.drawImage(image, (width - wide) / 2, (height - tall) / 2, wide, tall, 0, 0, 32, 24);
  const { data } = context.getImageData(0, 0, 32, 24);
  const shade = (_, at) => data[at * 4] + data[at * 4 + 1] + data[at * 4 + 2];
  return Array.from({ length: 32 * 24 }, shade);
}"""


def shades(page: Page, png: bytes, share: float) -> list[float]:
    source = "data:image/png;base64," + base64.b64encode(png).decode()
    return page.evaluate(SHADES, [source, share])


def scene(page: Page, share: float = 0.7) -> list[float]:
    """The 3D view once it has come to rest."""
    before = None
    for _ in range(60):
        now = shades(page, page.locator("#scene").screenshot(), share)
        if now == before:
            return now
        before = now
        page.wait_for_timeout(400)
    raise AssertionError("the 3D view does not come to rest")


def likeness(a: list[float], b: list[float]) -> float:
    """Correlation of the shades of two pictures, -1 to 1."""
    mean = [sum(each) / len(each) for each in (a, b)]
    pairs = [(x - mean[0], y - mean[1]) for x, y in zip(a, b, strict=True)]
    size = [math.sqrt(sum(pair[at] ** 2 for pair in pairs)) or 1.0 for at in (0, 1)]
    return sum(x * y for x, y in pairs) / (size[0] * size[1])


def difference(a: list[float], b: list[float]) -> float:
    """Mean difference of two pictures, 0 to 255 for each color."""
    return sum(abs(x - y) for x, y in zip(a, b, strict=True)) / len(a) / 3


def splats(page: Page) -> int:
    """Number of splats that are shown."""
    words = page.inner_text("#counted").replace(",", "").split()
    return int(words[0]) if words and "of" not in words else 0


def get(page: Page, path: str) -> bytes:
    return page.request.get(page.url.split("#")[0] + path).body()


def frames(page: Page) -> list[dict]:
    return page.request.get(page.url.split("#")[0] + "v1/maps/room/frames").json()["frames"]


def opens(page: Page, address: str) -> None:
    page.goto(f"{address}#map=room")
    expect(page.locator("#strip button").first).to_be_visible(timeout=TIMEOUT_MS)
    wait(page, "splats", lambda: splats(page) > 0)
    assert page.get_attribute("#in3d", "aria-checked") == "true", "it is what is shown first"
    shown = scene(page)
    assert sum(shade > 60 for shade in shown) > len(shown) / 2, "splats are brighter than nothing"
    page.select_option("#maps", "empty")
    wait(page, "no splats", lambda: splats(page) == 0)
    expect(page.locator("#loading")).to_have_text("nothing has been mapped yet")
    dark = scene(page)
    assert sum(shade > 60 for shade in dark) < len(dark) / 10, (
        "negative control: a map without splats"
    )
    page.select_option("#maps", "room")
    wait(page, "splats", lambda: splats(page) > 0)


def stand(page: Page, sequence: int) -> None:
    button = page.locator(f"#strip [data-sequence='{sequence}']")
    button.evaluate("(button) => button.click()", timeout=TIMEOUT_MS)
    expect(page.locator("#strip .chosen span")).to_have_text(str(sequence), timeout=TIMEOUT_MS)


def shows_what_the_server_renders(page: Page) -> None:
    """From a keyframe's place, the 3D view is like the server's picture, and the same way up."""
    first, *_, last = frames(page)
    stand(page, first["sequence"])
    page.wait_for_timeout(700)
    camera = first["camera"]
    own = camera["height"] / 2 / camera["fy"]
    space = math.tan(math.radians(FIELD / 2))
    seen = 0.8 * min(own, space)
    here = scene(page, seen / space)
    picture = "v1/maps/room/render?channel=color&width=320&frame={}"
    same, other = (
        shades(page, get(page, picture.format(frame["sequence"])), seen / own)
        for frame in (first, last)
    )
    upside_down = [shade for row in range(23, -1, -1) for shade in same[row * 32 : row * 32 + 32]]
    likenesses = [round(likeness(here, each), 3) for each in (same, other, upside_down)]
    print("likeness to its picture, another, upside down:", likenesses)
    assert likenesses[0] > 0.9 and max(likenesses[1:]) < 0.8, likenesses


def measures(page: Page) -> None:
    """The distance between two clicks is that of the server's depth."""
    first = frames(page)[0]
    camera = first["camera"]
    depth = page.request.get(
        f"{page.url.split('#')[0]}v1/maps/room/render?channel=depth&frame={first['sequence']}",
        headers={"accept": "application/x-npy"},
    ).body()
    start = 10 + struct.unpack_from("<H", depth, 8)[0]
    box = page.locator("#scene").bounding_box()
    assert box is not None
    page.click("#measure")
    points = []
    for across, up in ((-0.25, -0.1), (0.3, 0.15)):
        # The camera's own coordinates: x right, y down, z ahead, for z = 1.
        tall = 2 * math.tan(math.radians(FIELD / 2))
        x, y = across * tall * box["width"] / box["height"], -up * tall
        column = round(camera["fx"] * x + camera["cx"])
        row = round(camera["fy"] * y + camera["cy"])
        (z,) = struct.unpack_from("<f", depth, start + 4 * (row * camera["width"] + column))
        points.append((x * z, y * z, z))
        page.mouse.click(
            box["x"] + box["width"] * (0.5 + across), box["y"] + box["height"] * (0.5 - up)
        )
    expect(page.locator(".tag.length")).to_be_visible(timeout=TIMEOUT_MS)
    metres = float(page.inner_text(".tag.length").removesuffix(" m"))
    print(f"measured {metres} m, by the server's depth {math.dist(*points):.2f} m")
    assert abs(metres - math.dist(*points)) < 0.1, (metres, points)
    page.keyboard.press("Escape")
    expect(page.locator(".tag.length")).to_have_count(0)


def colors_what_was_asked(page: Page) -> None:
    plain = scene(page)
    ask(page, "wall")
    expect(page.locator("#answer .verdict")).to_contain_text("wall", timeout=TIMEOUT_MS)
    wait(page, "colors", lambda: difference(scene(page), plain) > 4)
    assert "ask=wall" in page.url and "camera=" in page.url, page.url
    # Negative control: without the question all is as before.
    ask(page, "")
    expect(page.locator("#answer")).to_contain_text(HINT, timeout=TIMEOUT_MS)
    wait(page, "no colors", lambda: difference(scene(page), plain) < 1)


def chooses_a_keyframe(page: Page) -> None:
    page.click("#home")
    page.wait_for_timeout(1500)
    scene(page)
    before = page.inner_text("#strip .chosen span")
    box = page.locator("#scene").bounding_box()
    assert box is not None
    places = page.evaluate(
        """async (frames) => {
          const { pixelOf } = await import(new URL('dashboard/space.js', document.baseURI));
          return frames.map((frame) => [frame.sequence, pixelOf(frame)]);
        }""",
        frames(page),
    )
    clear = [
        (sequence, pixel)
        for sequence, pixel in places
        if pixel
        and str(sequence) != before
        and 30 < pixel[0] < box["width"] - 30
        and 70 < pixel[1] < box["height"] - 60
    ]
    assert clear, places
    sequence, (x, y) = clear[0]
    # Negative control: a click beside all keyframes chooses none.
    page.mouse.click(box["x"] + box["width"] - 8, box["y"] + box["height"] - 8)
    assert page.inner_text("#strip .chosen span") == before
    page.mouse.click(box["x"] + x, box["y"] + y)
    expect(page.locator("#strip .chosen span")).not_to_have_text(before, timeout=TIMEOUT_MS)
    assert f"frame={page.inner_text('#strip .chosen span')}" in page.url, (page.url, sequence)


def keeps_its_camera(page: Page) -> None:
    page.wait_for_timeout(1000)
    old = page.url
    page.focus("#scene")
    page.keyboard.down("ArrowLeft")
    page.wait_for_timeout(600)
    page.keyboard.up("ArrowLeft")
    wait(page, "the camera in the address", lambda: page.url != old)
    page.wait_for_timeout(600)
    url, shown = page.url, scene(page)
    page.reload()
    wait(page, "splats", lambda: splats(page) > 0)
    again = scene(page)
    assert page.url == url, f"{page.url} after {url}"
    assert difference(again, shown) < 2, difference(again, shown)
    # Negative control: without the camera in the address the view is another.
    page.click("#home")
    page.wait_for_timeout(1500)
    assert difference(scene(page), shown) > 2


def grows(page: Page, folder: Path) -> None:
    settles(page)
    before = splats(page)
    (folder / "more").touch()
    wait(page, "more splats", lambda: splats(page) > before)


def walks(page: Page) -> None:
    page.click("[data-mode=walk]")
    expect(page.locator("#pad")).to_be_visible()
    wait(page, "walking in the address", lambda: "camera=walk" in page.url)
    page.click("#above")
    wait(page, "the view from above", lambda: "camera=orbit" in page.url and "_-1.05_" in page.url)
    for width, height in ((390, 844), (1280, 800)):
        page.set_viewport_size({"width": width, "height": height})
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, f"{wide} of {width} pixels"


def main() -> None:
    address, chromium, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    with sync_playwright() as playwright:
        launch = playwright.chromium.launch
        browser = launch(executable_path=chromium, args=["--no-sandbox", *SOFTWARE])
        page = browser.new_page(viewport={"width": 920, "height": 600})
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        steps = (
            lambda: opens(page, address),
            lambda: shows_what_the_server_renders(page),
            lambda: measures(page),
            lambda: colors_what_was_asked(page),
            lambda: chooses_a_keyframe(page),
            lambda: keeps_its_camera(page),
            lambda: walks(page),
            lambda: is_touched(browser, address),
            lambda: grows(page, folder),
        )
        for at, step in enumerate(steps):
            step()
            page.screenshot(path=folder / f"3d-{at}.png")
        browser.close()
        browser = launch(executable_path=chromium, args=["--no-sandbox", "--disable-3d-apis"])
        page = browser.new_page()
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(f"{address}#map=room")
        expect(page.locator("#caption")).to_contain_text("color", timeout=TIMEOUT_MS)
        expect(page.locator("#no3d")).to_be_visible()
        assert page.is_disabled("#in3d") and ink(page, "picture") > 0
        wait(page, "a plan that comes from the map", lambda: ink(page, "plan") > 100_000)
        browser.close()
    assert not faults, faults
    print(f"{len(steps) + 1} steps")


if __name__ == "__main__":
    main()
