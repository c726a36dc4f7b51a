"""Makes the pictures of README and documents, all from commands on the twin: docs/pictures.

    python docs/make_pictures.py [OUT]

It needs the extras `dev` and `view`, and an installed Chromium. tests/test_pictures.py makes them
again and compares.
"""

import io
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image, PngImagePlugin
from playwright.sync_api import Browser, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTH_PX = 1280
HEIGHT_PX = 800
STROKE = ("dynamic", "run", "--height", "215", "--speed", "2.433", "--repeats")
# The animation: smaller, so that it loads at once, and one frame of so many milliseconds of the
# stroke.
ANIMATED_PX = 960
FRAME_MS = 80
# Of the diagnosis, the first screen: the verdict, and a condition that was left out.
MARGIN_PX = 30
FIRST_SCREEN_PX = 770
# In the third stroke, when the leg is bent most.
MID_STROKE_S = 8.6
TEXT_WIDTH = (
    "e => { const range = document.createRange(); range.selectNodeContents(e); return "
    "range.getBoundingClientRect().width; }"
)
# The page takes no message after that time, and so stands still.
STAND_STILL = f"""() => {{
  const connection = rfcaView.connection, take = connection.take.bind(connection);
  connection.take = (event) => {{ if (!(rfcaView.shown.state.now_s > {MID_STROKE_S})) take(event); }};
}}"""


def rfca_rig(folder: Path, *words: str) -> None:
    """Runs a command there. Raises CalledProcessError where it fails."""
    subprocess.run(
        [sys.executable, "-m", "rfca_rig", *words], cwd=folder, check=True, capture_output=True
    )


@contextmanager
def viewed(folder: Path, *words: str) -> Iterator[str]:
    """The address of a view that a command opens, which ends with the block."""
    # The address is printed with the messages, to the error stream.
    process = subprocess.Popen(
        [sys.executable, "-m", "rfca_rig", *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        assert process.stdout is not None
        yield next(found[0] for line in process.stdout if (found := re.search(r"http://\S+", line)))
    finally:
        process.terminate()
        process.communicate()


def draw_diagnosis(browser: Browser, folder: Path, out: Path) -> None:
    """The first screen of the diagnosis of the README's job. The PNG's text chunks hold its
    words, and how wide the fonts here set them.
    """
    page = browser.new_page(viewport={"width": WIDTH_PX, "height": HEIGHT_PX})
    page.goto((folder / "diagnosis" / "diagnosis.html").as_uri())
    words = PngImagePlugin.PngInfo()
    words.add_itxt(
        "Description",
        "\n".join(page.locator(part).inner_text() for part in (".verdict", ".opening")),
    )
    # Another width means other fonts, with which no picture can be the same.
    words.add_text("Headline width", f"{page.locator('h1').evaluate(TEXT_WIDTH):.1f} px")
    first_screen = page.screenshot(
        clip={"x": 0, "y": MARGIN_PX, "width": WIDTH_PX, "height": FIRST_SCREEN_PX}
    )
    _opened(first_screen).save(out, optimize=True, pnginfo=words)
    page.close()


def draw_live_view(browser: Browser, folder: Path, out: Path) -> None:
    """A run on the twin that is watched, in mid-stroke."""
    page = browser.new_page(
        viewport={"width": WIDTH_PX, "height": HEIGHT_PX}, reduced_motion="reduce"
    )
    with viewed(folder, *STROKE, "5", "--view") as url:
        page.goto(url)
        page.wait_for_function("() => window.rfcaView?.shown.state")
        page.get_by_text("8 s", exact=True).first.click()
        page.evaluate(STAND_STILL)
        page.wait_for_function(f"() => rfcaView.shown.state.now_s > {MID_STROKE_S}")
        _opened(page.screenshot()).quantize(128).save(out, optimize=True)
        page.close()


def draw_replay(browser: Browser, folder: Path, run: str, out: Path, every: int = 1) -> None:
    """A recorded stroke, replayed: the animation of the README, or each `every`-th of its
    frames.
    """
    frames = []
    page = browser.new_page(
        viewport={"width": WIDTH_PX, "height": HEIGHT_PX}, reduced_motion="reduce"
    )
    with viewed(folder, "view", run) as url:
        page.goto(url)
        page.wait_for_function("() => window.rfcaView?.shown.state")
        # The expected force is there when the model is compiled.
        page.wait_for_function("() => rfcaView.traces.expected.byCondition.size > 0")
        page.get_by_text("2 s", exact=True).first.click()
        duration_ms = int(1e3 * page.evaluate("() => rfcaView.replay.durationS"))
        for at_s in (1e-3 * at_ms for at_ms in range(0, duration_ms, every * FRAME_MS)):
            page.evaluate(f"() => rfcaView.replay.seek({at_s})")
            page.wait_for_function(f"() => Math.abs(rfcaView.shown.state.now_s - {at_s}) < 0.01")
            # The traces are drawn at the next beat.
            page.wait_for_timeout(300)
            frame = _opened(page.screenshot())
            frames.append(
                frame.resize(
                    (ANIMATED_PX, ANIMATED_PX * frame.height // frame.width),
                    Image.Resampling.LANCZOS,
                )
            )
        page.close()
    frames[0].save(
        out,
        save_all=True,
        append_images=frames[1:],
        duration=FRAME_MS,
        loop=0,
        quality=60,
        method=6,
    )


def _opened(png: bytes) -> Image.Image:
    return Image.open(io.BytesIO(png)).convert("RGB")


def main(out: Path, job: Path | None = None, every: int = 1) -> None:
    """Runs the commands, and makes all pictures; of the animation, each `every`-th frame.

    `job` is a folder where the README's job has been done already, if there is one.
    """
    executable = next((path for path in map(shutil.which, BROWSERS) if path), None)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        if job is None:
            job = folder
            rfca_rig(job, "dynamic", "run", "--protocol", "table2", "--report", "report")
            rfca_rig(job, "diagnose", "runs/SIM-table-ii-001")
        rfca_rig(folder, *STROKE, "1")
        browser = playwright.chromium.launch(
            executable_path=executable, args=["--no-sandbox", "--disable-gpu"]
        )
        draw_diagnosis(browser, job, out / "diagnosis.png")
        draw_replay(
            browser,
            folder,
            "runs/SIM-flapping-215-mm-2.433-rad-per-s-001",
            out / "live-view.webp",
            every,
        )
        draw_live_view(browser, folder, out / "live-view.png")
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures")
