"""Film the studio for the README: ``python tests/film_studio.py docs/studio.gif``."""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from chromium import chromium, eventually, one, opened
from PIL import Image
from selenium.webdriver import Chrome
from test_studio_browser import played, said

from twosra_mpc import load_problem
from twosra_mpc.lab.studio import Server

WIDTH, HEIGHT, COLOURS, FRAME_MS = 1060, 860, 64, 130
PULLS = [*[(3, 7)] * 9, *[(-3, -7)] * 4, *[(5, 3)] * 5]  # of the goal's first unit [pixels]


def frames(browser: Chrome) -> Iterator[Image.Image]:
    """Pictures while the goal is bent by hand, and while the plan is played."""

    def picture() -> Image.Image:
        shot = Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB")
        return shot.resize((WIDTH * 5 // 8, HEIGHT * 5 // 8), Image.Resampling.LANCZOS)

    def mouse(kind: str, x: float, y: float) -> None:
        event = {"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1}
        browser.execute_cdp_cmd("Input.dispatchMouseEvent", event)

    def answers() -> int:
        return int(browser.execute_script("return latencies.length"))

    at = one(browser, ".handle.goal[data-name=segment0]").rect
    x, y = at["x"] + at["width"] / 2, at["y"] + at["height"] / 2
    mouse("mousePressed", x, y)
    yield from [picture()] * 4
    for dx, dy in PULLS:
        x, y, before = x + dx, y + dy, answers()
        mouse("mouseMoved", x, y)
        eventually(lambda before=before: answers() > before, 2.0)  # type: ignore[misc]
        yield picture()
    mouse("mouseReleased", x, y)
    eventually(lambda: played(browser) and said(browser, "status") == "optimal", 60.0)
    yield from [picture()] * 5
    last = int(one(browser, "#slider").get_property("max"))
    for frame in range(0, last + 1, last // 25):
        browser.execute_script(
            "const s = byId('slider'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))",
            frame,
        )
        yield picture()


def main(path: str) -> None:
    """Write the film."""
    server = Server(load_problem("paper-1"), name="paper-1")
    server.serve_in_background()
    with tempfile.TemporaryDirectory() as folder, chromium(Path(folder)) as browser:
        opened(browser, server.address, WIDTH)
        eventually(lambda: played(browser), 60.0)
        browser.execute_script("document.documentElement.style.overflow = 'hidden'")
        shots = [
            shot.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
            for shot in frames(browser)
        ]
    shots[0].save(path, save_all=True, append_images=shots[1:], duration=FRAME_MS, loop=0)


if __name__ == "__main__":
    main(sys.argv[1])
