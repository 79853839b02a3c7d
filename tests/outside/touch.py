"""Fingers on the 3D view: a part of space.py.

Touches are sent through the browser's own input, so that it may take them for scrolling.
"""

import math
from dataclasses import dataclass

from page import TIMEOUT_MS, wait
from playwright.sync_api import Browser, CDPSession, Page, expect

# Positions of fingers, pixels of the page.
Fingers = list[tuple[float, float]]
STEPS = 12


@dataclass(frozen=True)
class Camera:
    """The camera of the address: metres, radians."""

    eye: tuple[float, float, float]
    yaw: float
    pitch: float
    distance: float

    def ahead(self) -> tuple[float, float, float]:
        level = math.cos(self.pitch)
        return (-math.sin(self.yaw) * level, math.sin(self.pitch), -math.cos(self.yaw) * level)

    def center(self) -> tuple[float, ...]:
        """What is looked at."""
        return tuple(e + self.distance * a for e, a in zip(self.eye, self.ahead(), strict=True))


def camera(page: Page) -> Camera:
    """The camera once it rests: the address follows it."""
    page.wait_for_timeout(900)
    wait(page, "the camera in the address", lambda: "camera=orbit_" in page.url)
    values = page.url.split("camera=orbit_")[1].split("&")[0].split("_")
    x, y, z, yaw, pitch, distance = (float(value) for value in values)
    return Camera((x, y, z), yaw, pitch, distance)


def move(session: CDPSession, begin: Fingers, end: Fingers) -> None:
    """Fingers go down, move in straight lines, and leave."""

    def send(kind: str, points: Fingers) -> None:
        touches = [{"x": x, "y": y, "id": at} for at, (x, y) in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})

    send("touchStart", begin)
    for step in range(1, STEPS + 1):
        share = step / STEPS
        pairs = zip(begin, end, strict=True)
        send("touchMove", [(a + share * (c - a), b + share * (d - b)) for (a, b), (c, d) in pairs])
    send("touchEnd", [])


def is_touched(browser: Browser, address: str) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(f"{address}#map=room")
    expect(page.locator("#counted")).to_contain_text("splats", timeout=TIMEOUT_MS)
    session = page.context.new_cdp_session(page)
    box = page.locator("#scene").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def scrolled() -> float:
        return page.evaluate("scrollY")

    # One finger turns about what is looked at.
    before = camera(page)
    move(session, [(x, y)], [(x + 90, y + 30)])
    after = camera(page)
    assert 0.3 < before.yaw - after.yaw < 0.7 and after.pitch < before.pitch, (before, after)
    assert math.dist(before.center(), after.center()) < 0.02, (before, after)

    # Two fingers that part come nearer, and turn nothing.
    before = after
    move(session, [(x - 30, y), (x + 30, y)], [(x - 90, y), (x + 90, y)])
    after = camera(page)
    assert after.distance < 0.8 * before.distance, (before, after)
    assert (after.yaw, after.pitch) == (before.yaw, before.pitch), (before, after)

    # Two fingers side by side shift.
    before = after
    move(session, [(x - 40, y), (x + 40, y)], [(x - 40, y + 80), (x + 40, y + 80)])
    after = camera(page)
    assert (after.yaw, after.pitch) == (before.yaw, before.pitch), (before, after)
    assert abs(after.distance / before.distance - 1) < 0.05, (before, after)
    assert math.dist(before.eye, after.eye) > 0.1 * before.distance, (before, after)
    assert after.eye[1] > before.eye[1], "what is under the fingers follows them down"

    # Negative controls: a finger beside the 3D view scrolls the page, and so would one on it if the
    # browser took it.
    before = after
    assert scrolled() == 0, "the page stays where it is"
    page.evaluate(
        """() => {
          const sheet = new CSSStyleSheet();
          sheet.replaceSync('#scene { touch-action: auto !important; }');
          document.adoptedStyleSheets = [sheet];
        }"""
    )
    move(session, [(x, y + 60)], [(x, y - 120)])
    taken = camera(page)
    assert scrolled() > 50, "the browser scrolls"
    assert abs(taken.pitch - before.pitch) < 0.3, "and the camera is left"
    page.evaluate("document.adoptedStyleSheets = []; scrollTo(0, 0)")
    before = camera(page)
    move(session, [(x, 760)], [(x, 560)])
    assert scrolled() > 50 and camera(page) == before, "beside the 3D view"
    page.close()
    assert not faults, faults
