#!/usr/bin/env python3
"""Uses the dashboard in Chromium, as a person does.

    page.py http://127.0.0.1:8080/ CHROMIUM FOLDER

The server has the maps "room" and "other". FOLDER has a recording of 12 frames, `walk.zip`, and
`room.png`, which is none. Once the file FOLDER/more is there, somebody sends more
frames to "room". Screenshots are left in FOLDER.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Locator, Page, expect, sync_playwright

TIMEOUT_MS = 120_000
# Shown where there is no answer.
HINT = "Ask for one thing"


def ink(page: Page, canvas: str) -> int:
    """Number of pixels of a canvas that are not transparent."""
    return page.evaluate(
        """(id) => {
          const canvas = document.getElementById(id);
          const { width, height } = canvas;
          const { data } = canvas.getContext('2d').getImageData(0, 0, width, height);
          return data.filter((value, at) => at % 4 === 3 && value > 0).length;
        }""",
        canvas,
    )


def picture(page: Page) -> str:
    """The rendered view."""
    return page.evaluate("document.getElementById('picture').toDataURL()")


def ask(page: Page, text: str) -> None:
    page.fill("#text", text)
    page.press("#text", "Enter")
    expect(page.locator("#ask")).to_have_class("ask", timeout=TIMEOUT_MS)


def opens(page: Page, address: str) -> None:
    page.goto(f"{address}#channel=color")
    page.wait_for_selector("#strip button", timeout=TIMEOUT_MS)
    page.select_option("#maps", "room")
    expect(page.locator("#caption")).to_contain_text("color", timeout=TIMEOUT_MS)
    expect(page.locator("#status")).to_contain_text("mapper", timeout=TIMEOUT_MS)
    assert ink(page, "heat") == 0, "nothing was asked"


def answers(page: Page) -> None:
    ask(page, "wall")
    expect(page.locator("#answer .verdict")).to_contain_text("wall", timeout=TIMEOUT_MS)
    expect(page.locator("#answer")).to_contain_text("revision")
    assert "ask=wall" in page.url and "map=room" in page.url, page.url
    # "Not here" is never beside a box.
    here = "not here" not in page.inner_text("#answer")
    assert here == (page.locator("#marks rect").count() > 0), page.inner_text("#answer")


def asks_again_about_another_frame(page: Page) -> None:
    page.evaluate("document.activeElement.blur()")
    frame = page.inner_text("#strip .chosen span")
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#strip .chosen span")).not_to_have_text(frame)
    chosen = page.inner_text("#strip .chosen span")
    expect(page.locator("#answer")).to_contain_text(f"frame {chosen}:", timeout=TIMEOUT_MS)
    assert f"frame={chosen}" in page.url, page.url
    assert ink(page, "heat") > 0, "the heat map of the other frame"


def keeps_its_address(page: Page) -> None:
    before = page.url
    page.reload()
    expect(page.locator("#answer .verdict")).to_contain_text("wall", timeout=TIMEOUT_MS)
    assert page.url == before, f"{page.url} after {before}"


def forgets_with_the_map(page: Page) -> None:
    page.select_option("#maps", "other")
    expect(page.locator("#answer")).to_contain_text(HINT, timeout=TIMEOUT_MS)
    assert "map=other" in page.url and "ask" not in page.url, page.url
    assert ink(page, "heat") == 0 and page.locator("#marks rect").count() == 0


def compares_several(page: Page) -> None:
    ask(page, "wall, floor")
    expect(page.locator("#answer .legend")).to_have_count(2, timeout=TIMEOUT_MS)


def wait(page: Page, what: str, holds: Callable[[], bool]) -> None:
    """Waits until something holds. The page's policy forbids Playwright to wait in the page."""
    for _ in range(TIMEOUT_MS // 200):
        if holds():
            return
        page.wait_for_timeout(200)
    raise AssertionError(f"in vain: {what}")


def settles(page: Page) -> None:
    done = re.compile("mapper (settled|refining|converged)")
    expect(page.locator("#status")).to_contain_text(done, timeout=TIMEOUT_MS)


def is_live(page: Page, folder: Path) -> None:
    page.select_option("#maps", "room")
    expect(page.locator("#caption")).to_contain_text("color", timeout=TIMEOUT_MS)
    settles(page)
    page.uncheck("#follow")
    before, keyframes = picture(page), page.locator("#strip button").count()
    (folder / "more").touch()
    buttons = page.locator("#strip button")
    wait(page, "more keyframes", lambda: buttons.count() > keyframes)
    settles(page)
    wait(page, "another picture", lambda: picture(page) != before)


def has_a_time_line(page: Page) -> None:
    expect(page.locator("#timeline-text")).to_contain_text("48 frames tracked", timeout=TIMEOUT_MS)
    expect(page.locator("#timeline-text")).not_to_contain_text("gap")
    # Its left end is the first keyframe.
    page.locator("#timeline").click(position={"x": 1, "y": 13})
    expect(page.locator("#strip .chosen span")).to_have_text("0")


def row(page: Page, name: str) -> Locator:
    """The row of a map in the dialog that manages maps."""
    return page.locator("#manager-maps tr").filter(
        has=page.get_by_role("button", name=name, exact=True)
    )


def manages(page: Page, folder: Path) -> None:
    page.get_by_role("button", name="Manage maps").click()
    page.fill("#create-name", "hall")
    page.press("#create-name", "Enter")
    expect(row(page, "hall")).to_contain_text("empty", timeout=TIMEOUT_MS)
    page.fill("#create-name", "hall")
    page.press("#create-name", "Enter")
    expect(page.locator("#manager-error")).to_contain_text("already", timeout=TIMEOUT_MS)
    page.get_by_role("button", name="Rename hall").click()
    page.get_by_label("new name of hall").fill("attic")
    page.get_by_label("new name of hall").press("Enter")
    expect(row(page, "attic")).to_be_visible(timeout=TIMEOUT_MS)
    expect(row(page, "hall")).to_have_count(0)
    expect(page.locator("#manager-error")).to_be_hidden()

    page.get_by_role("button", name="Download other").click()
    with page.expect_download(timeout=TIMEOUT_MS) as download:
        page.get_by_role("link", name="backup").click()
    file = folder / download.value.suggested_filename
    download.value.save_as(file)
    page.set_input_files("#restore-file", file)
    page.fill("#restore-name", "copy")
    page.click("#restore button")
    done = re.compile("settled|refining|converged")
    expect(row(page, "copy")).to_contain_text(done, timeout=TIMEOUT_MS)
    frames = row(page, "other").locator("td").nth(2).inner_text()
    assert row(page, "copy").locator("td").nth(2).inner_text() == frames

    # The first click only asks.
    page.get_by_role("button", name="Delete attic").click()
    again = page.get_by_role("button", name="Delete for ever attic")
    expect(row(page, "attic")).to_be_visible()
    again.click()
    expect(row(page, "attic")).to_have_count(0, timeout=TIMEOUT_MS)
    page.get_by_role("button", name="close").click()
    expect(page.locator("#maps option", has_text="copy")).to_have_count(1, timeout=TIMEOUT_MS)
    expect(page.locator("#maps option", has_text="attic")).to_have_count(0)


def uploads(page: Page, folder: Path) -> None:
    """Uploads a recording and watches it being mapped."""
    page.get_by_role("button", name="Manage maps").click()
    page.set_input_files("#import-file", folder / "room.png")
    assert page.input_value("#import-name") == "room"
    page.fill("#import-name", "walk")
    page.click("#import button")
    expect(page.locator("#manager-error")).to_contain_text("expected", timeout=TIMEOUT_MS)
    page.set_input_files("#import-file", folder / "walk.zip")
    page.click("#import button")
    expect(page.locator("#manager")).to_be_hidden(timeout=TIMEOUT_MS)
    expect(page.locator("#importing-text")).to_contain_text("frames", timeout=TIMEOUT_MS)
    expect(page.locator("#importing-text")).to_contain_text(
        "is mapped: 12 of 12 frames", timeout=TIMEOUT_MS
    )
    assert "map=walk" in page.url, page.url
    expect(page.locator("#strip button").first).to_be_visible(timeout=TIMEOUT_MS)
    page.reload()
    page.wait_for_selector("#strip button", timeout=TIMEOUT_MS)
    expect(page.locator("#importing")).to_be_hidden()
    page.select_option("#maps", "room")


def says_what_is_wrong(page: Page) -> None:
    ask(page, "not a wall")
    expect(page.locator("#error")).to_be_visible(timeout=TIMEOUT_MS)
    expect(page.locator("#answer")).to_contain_text(HINT)
    ask(page, "wall")
    expect(page.locator("#error")).to_be_hidden(timeout=TIMEOUT_MS)


def fits(page: Page) -> None:
    for width, height in ((390, 844), (1280, 800), (2200, 1200)):
        page.set_viewport_size({"width": width, "height": height})
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, f"{wide} of {width} pixels"


AXE = Path(__file__).parents[2] / ".deps/viewers/node_modules/axe-core/axe.min.js"


def is_accessible(page: Page) -> None:
    """No rule of axe is broken: dark and light, with the dialog closed and open."""
    if not AXE.exists():
        print("SKIPPED: axe-core is not there (deploy/setup.sh --tests, which needs npm)")
        return
    page.evaluate(AXE.read_text())
    check = """axe.run().then((report) =>
      report.violations.map(({ id, nodes }) => `${id}: ${nodes[0].html}`))"""
    for theme in ("dark", "light"):
        page.emulate_media(color_scheme=theme)
        broken = page.evaluate(check)
        assert broken == [], f"{theme}: {broken}"
        page.get_by_role("button", name="Manage maps").click()
        expect(row(page, "room")).to_be_visible(timeout=TIMEOUT_MS)
        broken = page.evaluate(check)
        assert broken == [], f"{theme}: {broken}"
        page.get_by_role("button", name="close").click()
    # Negative control: a picture that says nothing.
    page.get_by_role("button", name="Manage maps").click()
    page.evaluate("document.getElementById('manager').append(document.createElement('img'))")
    assert any("image-alt" in broken for broken in page.evaluate(check))
    page.get_by_role("button", name="close").click()


def main() -> None:
    address, chromium, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        steps = (
            lambda: opens(page, address),
            lambda: answers(page),
            lambda: asks_again_about_another_frame(page),
            lambda: keeps_its_address(page),
            lambda: forgets_with_the_map(page),
            lambda: compares_several(page),
            lambda: is_live(page, folder),
            lambda: has_a_time_line(page),
            lambda: manages(page, folder),
            lambda: uploads(page, folder),
            lambda: says_what_is_wrong(page),
            lambda: fits(page),
            lambda: is_accessible(page),
        )
        for at, step in enumerate(steps):
            step()
            page.screenshot(path=folder / f"{at}.png")
        browser.close()
    assert not faults, faults
    print(f"{len(steps)} steps")


if __name__ == "__main__":
    main()
