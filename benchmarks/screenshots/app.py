"""A session in the app, from a stack and a log to forces: docs/images/app_*.png.

PYTHONPATH=benchmarks python -m screenshots.app
"""

from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread

import numpy as np
import tifffile
from playwright.sync_api import Page, expect

import scleraforce as sf
from monitor.browser import chromium, keep_picture
from scleraforce.front.app.app_server import HOST, listen_locally, server_of
from scleraforce.front.app.asked_jobs import CommandWords
from scleraforce.front.cli.field_flags import flag_of, json_in_flags

FORCES_N = tuple(1e-3 * force for force in (3, 9, 15, 21, 27, 33, 39, 31, 23, 16, 8, 4))
OFFSET_S = 7.0
TOKEN = "screenshots"
SPELLED = CommandWords(flag_of, json_in_flags)
WAIT_MS = 120_000
GIVEN = {
    "depth_mm": "4",
    "refractive_index": "1",
    "bits": "12",
    "eye": "mine",
    "gauge": "22",
    "gap_mm": "0.5",
    "thickness_um": "650",
    "iop_mmhg": "2",
}


def write_sources(folder: Path) -> list[str]:
    """Write what a laboratory has: a stack without a scale, a log in ms and mN on
    another clock, and frames' times.
    """
    sf.phantom(
        folder / "eye",
        eye="eye",
        mechanics="finite-strain",
        forces_n=list(FORCES_N),
        thickness_m=650e-6,
        youngs_modulus_pa=0.3e6,
        globe="open",
    )
    recording = sf.read_recording(folder / "eye")
    frames = [recording.frame(entry) for entry in recording.frames]
    tifffile.imwrite(folder / "scan.tif", np.array(frames), photometric="minisblack")
    log = np.loadtxt(folder / "eye" / "forces.csv", delimiter=",", skiprows=1)
    table = np.column_stack(
        [1e3 * (log[:, 0] + OFFSET_S), 1e3 * log[:, 1], -1e3 * log[:, 3]]
    )
    np.savetxt(
        folder / "log.csv",
        table,
        "%.2f",
        ",",
        header="Time (ms),Fx (mN),Fz (mN)",
        comments="",
    )
    times = "".join(
        f"{n + 1},{entry.time_s}\n" for n, entry in enumerate(recording.frames)
    )
    (folder / "times.csv").write_text(f"frame,time_s\n{times}", encoding="utf-8")

    return [str(folder / name) for name in ("scan.tif", "log.csv", "times.csv")]


def main() -> None:
    """Serve an empty folder, go through the five steps, and keep a picture of each."""
    with TemporaryDirectory() as folder, chromium() as browser:
        sources = write_sources(Path(folder))
        work = Path(folder, "session")
        work.mkdir()
        listener = listen_locally(0)
        server = server_of(work, listener, TOKEN, SPELLED)
        Thread(target=server.run, args=([listener],), daemon=True).start()
        page = browser.new_page(viewport={"width": 1280, "height": 860})
        page.set_default_timeout(WAIT_MS)
        expect.set_options(timeout=WAIT_MS)
        page.goto(f"http://{HOST}:{listener.getsockname()[1]}/?token={TOKEN}")

        with suppress(KeyboardInterrupt):
            _session(page, sources)

        server.should_exit = True


def _session(page: Page, sources: list[str]) -> None:
    page.set_input_files("#files", sources)
    expect(page.locator("#source-size")).to_contain_text(f"{len(FORCES_N)} frames")
    picture = page.locator("#source-picture").bounding_box()
    assert picture is not None
    y = picture["y"] + 0.75 * picture["height"]
    page.mouse.move(picture["x"] + 0.1 * picture["width"], y)
    page.mouse.down()
    page.mouse.move(picture["x"] + 0.9 * picture["width"], y, steps=5)
    page.mouse.up()
    page.fill("#bar-mm", "12")
    _keep(page, "import")
    page.click("#bar-take")

    for name, text in GIVEN.items():
        page.fill(f"[data-name={name}] input", text)

    page.select_option("[data-name=globe] select", "open")
    page.locator("#log-plots svg").nth(1).click()
    expect(page.locator("[data-name=contact_sign] select")).to_have_value("1")
    page.click("#propose")
    expect(page.locator("#clock-text")).to_contain_text("proposed")
    page.fill("#import-out", "mine")
    expect(page.locator("#import-command")).to_contain_text("--out=mine")
    page.locator("#log").scroll_into_view_if_needed()
    _keep(page, "clocks", "#log")
    page.click("#import-run")
    expect(page.locator("#place")).to_contain_text(f"1 of {len(FORCES_N)}")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#place")).to_contain_text("2 of")
    page.click("[data-step=correct]")
    expect(page.locator("#verdict")).to_contain_text("mN")
    _keep(page, "correct")
    page.click("[data-step=calibrate]")
    page.check("#calibrate .recordings input")
    page.click("#calibrate-run")
    expect(page.locator("#calibrate-result table")).to_be_visible()
    page.click("[data-step=read]")
    page.check("#read .recordings input")
    page.select_option("#read-calibration", "calibration.json")
    page.click("#read-run")
    expect(page.locator("#read-result table")).to_be_visible()
    _keep(page, "read")


def _keep(page: Page, name: str, part: str | None = None) -> None:
    page.evaluate("window.scrollTo(0, 0)")
    page.wait_for_timeout(700)  # pictures of the strip arrive
    keep_picture(page if part is None else page.locator(part), f"app_{name}")
    print(f"{name}: {page.text_content('#fault') or 'no fault'}", flush=True)


if __name__ == "__main__":
    main()
