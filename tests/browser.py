"""A headless Chromium for tests of pages: offline, drawn in software. Tests are skipped where there is none."""

import shutil
import time
from contextlib import contextmanager

import pytest

ARGUMENTS = (
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-first-run",
    "--disable-dev-shm-usage", "--disable-extensions", "--force-device-scale-factor=1", "--window-size=1000,700",
    "--host-resolver-rules=MAP * ~NOTFOUND", "--force-prefers-reduced-motion",
)


def missing():
    """Why pages cannot be driven here; "" where they can."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        return "needs chromium and chromedriver (Debian: chromium, chromium-driver)"
    try:
        import selenium  # noqa: F401
    except ImportError:
        return "needs selenium (pip install '.[dev]')"
    return ""


needs_browser = pytest.mark.skipif(bool(missing()), reason=missing())


@contextmanager
def chromium():
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for argument in ARGUMENTS:
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        driver.set_network_conditions(offline=True, latency=0, throughput=0)
        driver.set_script_timeout(60)
        yield Page(driver)
    finally:
        driver.quit()


class Page:
    def __init__(self, driver):
        self.driver = driver

    def open(self, path):
        self.driver.get(path.as_uri())
        self.until("return window.cabslice && (cabslice.state.ready || cabslice.state.failed)")
        self.settle()

    def run(self, script, *arguments):
        return self.driver.execute_script(script, *arguments)

    def until(self, script, seconds=90):
        end = time.monotonic() + seconds
        while not (found := self.run(script)):
            assert time.monotonic() < end, f"waited {seconds} s for: {script}"
            time.sleep(0.03)
        return found

    def settle(self):
        """Until the picture is whole and nothing moves."""
        self.until("return cabslice.state.settled && !cabslice.camera.flight && !cabslice.state.playing")

    def log(self):
        """What the console was told since the last call."""
        return [row["message"] for row in self.driver.get_log("browser")]

    def text(self, css):
        return self.run("return document.querySelector(arguments[0]).innerText", css)
