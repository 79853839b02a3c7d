#!/usr/bin/env python3
"""Times answers on the dashboard: from the Enter key until the answer is shown.

    PYTHONPATH=.deps/browser answer_time.py http://127.0.0.1:8080/ CHROMIUM MAP chair table lamp

Asks each word in the 3D view and in the fixed view of colors. The browser draws in software.
"""

import sys
import time

from playwright.sync_api import sync_playwright
from space import SOFTWARE

SETTLES_MS = 9000
# Between two questions: the splats get their colors after the answer is shown.
PAUSE_MS = 4000


def main() -> None:
    address, chromium, name, *words = sys.argv[1:]
    with sync_playwright() as playwright:
        launch = playwright.chromium.launch
        for view in ("3D", "color"):
            browser = launch(executable_path=chromium, args=["--no-sandbox", *SOFTWARE])
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            page.goto(f"{address}#map={name}&channel={view}")
            page.wait_for_timeout(SETTLES_MS)
            for word in words:
                began = time.monotonic()
                page.fill("#text", word)
                page.press("#text", "Enter")
                verdict = page.locator("#answer .verdict", has_text=f"“{word}”")
                while verdict.count() == 0:
                    time.sleep(0.01)
                print(f"{view}: {word} {time.monotonic() - began:.2f} s")
                page.wait_for_timeout(PAUSE_MS)
            browser.close()


if __name__ == "__main__":
    main()
