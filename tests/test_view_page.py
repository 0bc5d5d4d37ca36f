"""The page of the live view in a real browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import browser
import pytest
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from view_client import SCENE

from furcl.device.choice import Device
from furcl.scene.read import decode_scene
from furcl.viewer.show import View

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(browser.missing()), reason=f"no browser: {browser.missing()}"),
]

PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def view(device: Device) -> Iterator[View]:
    with View(decode_scene(SCENE), device) as shown:
        yield shown


@pytest.fixture(scope="module")
def driver(view: View) -> Iterator[Any]:
    driver = browser.open_browser()
    try:
        driver.get(view.address)
        until(lambda: text(driver, "doing") == "done")
        yield driver
        wrong = [line for line in driver.get_log("browser") if line["level"] == "SEVERE"]
        assert wrong == []
    finally:
        driver.quit()


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "the page does not say what is waited for"
        time.sleep(0.05)


def text(driver: Any, name: str) -> str:
    return driver.find_element(By.ID, name).text


def middle(driver: Any) -> list[int]:
    """The colour in the middle of the canvas, and how many colours the canvas has."""
    return driver.execute_script(
        "const c = document.getElementById('canvas'), x = c.getContext('2d');"
        "const all = new Uint32Array(x.getImageData(0, 0, c.width, c.height).data.buffer);"
        "return [all[(c.height >> 1) * c.width + (c.width >> 1)], new Set(all).size];"
    )


def key(driver: Any, *keys: str) -> None:
    ActionChains(driver).send_keys(*keys).perform()


def test_picture_and_facts(driver: Any) -> None:
    assert text(driver, "scene") == "patch"
    assert text(driver, "samples") == "4 of 4 samples"
    assert text(driver, "noise").startswith("noise ")
    assert middle(driver)[1] > 20


def test_mouse_turns_the_camera(driver: Any) -> None:
    before = text(driver, "azimuth")
    canvas = driver.find_element(By.ID, "canvas")
    ActionChains(driver).drag_and_drop_by_offset(canvas, 80, 20).perform()
    until(lambda: text(driver, "azimuth") != before)
    until(lambda: text(driver, "doing") == "done")
    driver.find_element(By.ID, "reset-camera").click()
    until(lambda: text(driver, "azimuth") == before)


def test_keys_turn_it_and_choose(driver: Any) -> None:
    driver.find_element(By.ID, "canvas").click()
    before = text(driver, "elevation")
    key(driver, Keys.ARROW_UP)
    until(lambda: text(driver, "elevation") != before)
    key(driver, "p")
    pressed = driver.find_element(By.CSS_SELECTOR, "[data-tool=picture]")
    until(lambda: pressed.get_attribute("aria-pressed") == "true")
    zoom = text(driver, "zoom")
    key(driver, "+")
    until(lambda: text(driver, "zoom") != zoom)
    key(driver, "0", "c")
    until(lambda: text(driver, "zoom") == zoom)


def test_exposure_is_toned_here(driver: Any) -> None:
    before = middle(driver)[0]
    driver.find_element(By.ID, "canvas").click()
    key(driver, *"[[[[[[[[")
    until(lambda: middle(driver)[0] != before)
    assert text(driver, "doing") == "done"
    key(driver, *"]]]]]]]]")
    until(lambda: middle(driver)[0] == before)


def test_slider_changes_the_fibre_and_its_lobes(driver: Any) -> None:
    until(lambda: "TT" in text(driver, "legend"))
    before = text(driver, "legend")
    slider = driver.find_element(By.ID, "field-eta")
    ActionChains(driver).drag_and_drop_by_offset(slider, 60, 0).perform()
    until(lambda: "fibre.eta" in text(driver, "changed"))
    until(lambda: text(driver, "legend") != before)
    driver.find_element(By.CSS_SELECTOR, "#changed button").click()
    until(lambda: text(driver, "changed") == "")


def test_region(driver: Any) -> None:
    key(driver, "r")
    canvas = driver.find_element(By.ID, "canvas")
    chain = ActionChains(driver).move_to_element_with_offset(canvas, -60, -40).click_and_hold()
    chain.move_by_offset(90, 60).release().perform()
    whole = driver.find_element(By.ID, "whole")
    until(whole.is_displayed)
    until(lambda: text(driver, "doing") == "done")
    whole.click()
    until(lambda: not whole.is_displayed())
    key(driver, "c")


def test_two_settings(driver: Any) -> None:
    driver.find_element(By.ID, "canvas").click()
    key(driver, "b")
    until(lambda: text(driver, "copy") == "Copy B to A")
    box = driver.find_element(By.ID, "set-text")
    box.send_keys("fibre.preset = black", Keys.ENTER)
    until(lambda: text(driver, "changed").startswith("fibre.preset"))
    until(lambda: text(driver, "doing") == "done")
    driver.find_element(By.ID, "split").click()
    until(lambda: middle(driver)[1] > 20)
    driver.find_element(By.ID, "split").click()
    driver.find_element(By.CSS_SELECTOR, "[data-slot=A]").click()
    until(lambda: text(driver, "copy") == "Copy A to B")


def test_errors_are_shown(driver: Any) -> None:
    box = driver.find_element(By.ID, "set-text")
    box.clear()
    box.send_keys("fibre.eta = 99", Keys.ENTER)
    until(lambda: "1.0001 to 3" in text(driver, "message"))
    driver.find_element(By.ID, "message").click()
    until(lambda: text(driver, "message") == "")


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (1000, 700), (420, 900)])
def test_nothing_sticks_out(driver: Any, width: int, height: int) -> None:
    browser.resize(driver, width, height)
    out = driver.execute_script(
        "const [w, h] = [innerWidth, innerHeight], out = [];"
        "for (const e of document.querySelectorAll('#bar *, #panel section *')) {"
        "  const b = e.getBoundingClientRect();"
        "  if (b.width && (b.left < -1 || b.right > w + 1)) out.push(e.id || e.outerHTML);"
        "}"
        "const canvas = document.getElementById('canvas').getBoundingClientRect();"
        "if (canvas.height < 150 || canvas.bottom > h) out.push('canvas');"
        "return out;"
    )
    browser.resize(driver, 1400, 900)
    assert out == []
