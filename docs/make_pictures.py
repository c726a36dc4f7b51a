"""Makes the pictures of README and documents, all from commands on the twin: docs/pictures.

    python docs/make_pictures.py [OUT]

It needs the extras `dev` and `view`, and an installed Chromium. tests/test_pictures.py makes them
again and compares. real-recording.png is made of a public set of recordings, which is diagnosed for
some minutes: python docs/make_pictures.py OUT FOLDER, after `rfca-rig datasets get sines-both`.
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

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image, PngImagePlugin
from playwright.sync_api import Browser, sync_playwright

from rfca_rig.reports.style import MEASURED, OTHER, SIMULATED, drawing

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
# Of the public set: a motion, and by which share the first bin of a stretch is off the even times.
SHOWN_MOTION = "shoulder up to 0.6 N m, elbow 0.4"
UNEVEN = 0.05
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


def draw_real_recording(experiment: Path, out: Path) -> None:
    """A motion of a double pendulum that other people recorded, with both models; and how each
    model predicts what was left out of its fit.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rfca_rig(folder, "diagnose", str(experiment.resolve()), "--out", "diagnosis")
        signals = pd.read_csv(folder / "diagnosis" / "signals.csv")
        errors = pd.read_csv(folder / "diagnosis" / "before-after.csv").set_index("difference")
    with drawing():
        figure = Figure(figsize=(9.6, 3.4), layout="constrained")
        motion, bars = figure.subplots(1, 2, width_ratios=(3, 1))
        draw_motion(motion, signals)
        draw_errors(bars, errors)
        figure.legend(frameon=False, fontsize=8.5, loc="outside upper left", ncols=3)
        figure.savefig(out, dpi=133, metadata={"Software": None})


def draw_motion(axes: Axes, signals: pd.DataFrame) -> None:
    """The elbow in the motion that the uncorrected model misses most clearly."""
    is_shown = signals["condition"].str.startswith(SHOWN_MOTION)
    elbow = signals[is_shown & (signals["signal"] == "elbow_position_rad")]
    # Each stretch starts from the recording, so no line may join two. Bins are even within one.
    t_s = elbow["t_s"].to_numpy()
    steps_s = np.diff(t_s, prepend=t_s[0])
    is_first = np.abs(steps_s - np.median(steps_s)) > UNEVEN * np.median(steps_s)
    stretch = np.cumsum(is_first)
    for name, label, style in (
        ("amended", "model with the friction that was found", {"color": SIMULATED, "lw": 3.2}),
        ("nominal", "published model without friction", {"color": OTHER, "lw": 1.2, "ls": "--"}),
        ("measured", "measured", {"color": MEASURED, "lw": 1.2}),
    ):
        degrees = np.degrees(elbow[name].to_numpy())
        for number in np.unique(stretch):
            rows = stretch == number
            first = number == stretch[0]
            axes.plot(elbow["t_s"][rows], degrees[rows], label=label if first else None, **style)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("angle of the elbow (deg)")


def draw_errors(axes: Axes, errors: pd.DataFrame) -> None:
    """Errors in stretches that were left out of the fit, with and without friction."""
    names = ["shoulder position", "elbow position"]
    before = np.degrees(errors.loc[names, "held_out_before"])
    after = np.degrees(errors.loc[names, "held_out_after"])
    places = np.arange(len(names))
    for offset, values, colour in ((-0.2, before, OTHER), (0.2, after, SIMULATED)):
        bars = axes.bar(places + offset, values, 0.36, color=colour)
        axes.bar_label(bars, fmt="%.1f", fontsize=8.5)
    axes.set_xticks(places, ["shoulder", "elbow"])
    axes.set_title("left out of the fit", fontsize=9.2)
    axes.set_ylabel("rms error (deg)")


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
    chosen = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"
    if len(sys.argv) > 2:
        draw_real_recording(Path(sys.argv[2]), chosen / "real-recording.png")
    else:
        main(chosen)
