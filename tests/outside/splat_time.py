#!/usr/bin/env python3
"""How soon the dashboard shows a map's splats in Chromium, from opening the page.

    splat_time.py http://127.0.0.1:8080/ CHROMIUM MAP

Prints, for five visits, milliseconds until the first paint, until the first piece of the splats
is drawn and until all are.
"""

import sys

from page import wait
from playwright.sync_api import Page, sync_playwright
from space import SOFTWARE

VISITS = 5
# Notes when the number of splats changes on the page, and two frames have been drawn since.
WATCH = """document.addEventListener('DOMContentLoaded', () => {
  window.noted = [];
  const counted = document.getElementById('counted');
  const note = (text) => () => window.noted.push([Math.round(performance.now()), text]);
  const seen = () => requestAnimationFrame(() => requestAnimationFrame(note(counted.textContent)));
  new MutationObserver(seen).observe(counted, { childList: true });
})"""


def noted(page: Page) -> list[tuple[int, str]]:
    return [(at, text) for at, text in page.evaluate("window.noted ?? []") if text]


def whole(page: Page) -> bool:
    return any(" of " not in text for _, text in noted(page))


def main() -> None:
    address, chromium, name = sys.argv[1:]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", *SOFTWARE]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.add_init_script(WATCH)
        for _ in range(VISITS):
            page.goto("about:blank")
            page.goto(f"{address}#map={name}")
            wait(page, "all splats", lambda: whole(page))
            paint = page.evaluate("performance.getEntriesByType('paint')[0].startTime")
            first, last = noted(page)[0], next(n for n in noted(page) if " of " not in n[1])
            print(f"first paint {paint:.0f} ms; {first[1]} {first[0]} ms; {last[1]} {last[0]} ms")
        browser.close()


if __name__ == "__main__":
    main()
