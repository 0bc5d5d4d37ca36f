"""Chromium without a window, for the picture of the live view and its test."""

from __future__ import annotations

import shutil
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
DRIVER = "chromedriver"


def missing() -> str:
    """What of browser and driver is not there; empty if both are."""
    absent = []
    if not any(map(shutil.which, BROWSERS)):
        absent.append("Chromium")
    if not shutil.which(DRIVER):
        absent.append(DRIVER)
    return f"{' and '.join(absent)}: apt-get install chromium chromium-driver" if absent else ""


def open_browser(width: int = 1400, height: int = 900) -> Any:
    """A driver whose page has that size [pixels]."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = next(path for path in map(shutil.which, BROWSERS) if path)
    for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(shutil.which(DRIVER)))
    resize(driver, width, height)
    return driver


def resize(driver: Any, width: int, height: int) -> None:
    """Give the page, not the window, a size."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
