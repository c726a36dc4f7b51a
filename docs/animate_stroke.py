"""Makes docs/pictures/live-view.webp: a recorded stroke, replayed on the page of the live view.

    python docs/animate_stroke.py RUN OUT.webp

RUN is a recording of one stroke on the twin. It needs the extras `dev` and `view`, and an installed Chromium.
"""

import io
import re
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

SIZE_PX, WIDTH_PX = {"width": 1280, "height": 800}, 960
FRAME_MS = 80


def photograph(url: str, executable: str) -> list[Image.Image]:
    """The page at each time, scaled down."""
    frames = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        page = browser.new_page(viewport=SIZE_PX, reduced_motion="reduce")
        page.goto(url)
        page.wait_for_function("() => window.rfcaView?.shown.state")
        page.get_by_text("2 s", exact=True).first.click()
        duration_ms = int(1e3 * page.evaluate("() => rfcaView.replay.durationS"))
        for at_s in (1e-3 * at_ms for at_ms in range(0, duration_ms, FRAME_MS)):
            page.evaluate(f"() => rfcaView.replay.seek({at_s})")
            page.wait_for_function(f"() => Math.abs(rfcaView.shown.state.now_s - {at_s}) < 0.01")
            # The traces are drawn at the next beat.
            page.wait_for_timeout(300)
            frame = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            frames.append(frame.resize((WIDTH_PX, WIDTH_PX * frame.height // frame.width), Image.Resampling.LANCZOS))
        browser.close()
    return frames


def main(run: Path, out: Path, executable: str = "/usr/bin/chromium") -> None:
    """Replays the run, and writes the animation."""
    view = subprocess.Popen(
        [sys.executable, "-m", "rfca_rig", "view", str(run)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        assert view.stdout is not None
        url = next(found[0] for line in view.stdout if (found := re.search(r"http://\S+", line)))
        first, *others = photograph(url, executable)
    finally:
        view.terminate()
    first.save(out, save_all=True, append_images=others, duration=FRAME_MS, loop=0, quality=60, method=6)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
