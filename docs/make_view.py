"""Draws docs/pictures/view.png, the live view in a browser: python docs/make_view.py.

Needs furcl[view], selenium, Chromium and its driver.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from browser import open_browser

import furcl

PICTURE = Path(__file__).with_name("pictures") / "view.png"
PATIENCE_S = 600.0


def text(driver: Any, name: str) -> str:
    return driver.execute_script("return document.getElementById(arguments[0]).textContent", name)


def wait_until_done(driver: Any) -> None:
    end = time.monotonic() + PATIENCE_S
    while text(driver, "doing") != "done" and time.monotonic() < end:
        time.sleep(0.5)


def main() -> None:
    with furcl.view("red_fox", size=(400, 400), spp=8) as view:
        driver = open_browser()
        try:
            driver.get(view.address)
            wait_until_done(driver)
            driver.execute_script(
                "document.getElementById('copy').click();"
                "document.querySelector('[data-slot=B]').click();"
            )
            time.sleep(1.0)
            driver.execute_script(
                "const slider = document.getElementById('field-beta_m_deg');"
                "slider.value = 0.9; slider.dispatchEvent(new Event('input'));"
            )
            time.sleep(5.0)
            wait_until_done(driver)
            driver.execute_script(
                "document.getElementById('split').click();"
                "document.getElementById('panel').scrollTop = 400;"
            )
            time.sleep(1.0)
            driver.save_screenshot(str(PICTURE))
        finally:
            driver.quit()


if __name__ == "__main__":
    main()
