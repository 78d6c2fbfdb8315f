"""The console of a real monitor in headless Chromium: docs/images/console*.png.

PYTHONPATH=benchmarks python -m screenshots.console [--model default] [--out
docs/images/console.png] [--width 1280]

A virtual needle pushes to 36 mN (FILE: the withdrawal), and in another session through
the wall at 22 mN. There the bound comes nearer (FILE-watching, in the dark scheme), and
the puncture is found (FILE-pierced). On a busy machine frames come too late, and the
pictures show that instead: look at them.
"""

import argparse
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
from playwright.sync_api import Page, ViewportSize, sync_playwright

import scleraforce as sf
from monitor.browser import CHROMIUM
from monitor.real_monitor import real_monitor
from scleraforce.records.model_folder import SHIPPED_READER

PUSHES_N = {"": ([12e-3, 6e-3, 36e-3], None), "-pierced": ([12e-3, 6e-3, 20e-3], 22e-3)}
WAIT_MS = 120_000.0
COMMAND = (sys.executable, "-c", "from scleraforce.front.cli.main import main; main()")
WITHDRAWN = (
    "document.getElementById('word').textContent === 'WITHDRAW' &&"
    " document.getElementById('frame').textContent"
)
PIERCED = "document.getElementById('sentence').textContent.includes('gone through')"
NEAR = (
    "document.querySelector('#until[data-near]') &&"
    " Number(document.getElementById('force').textContent) > 11"
)


def main() -> None:
    """Play both sessions, keep the pictures, and print what they show."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", type=Path, default=SHIPPED_READER)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(__file__).parents[2] / "docs" / "images" / "console.png",
    )
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=720)
    given = parser.parse_args()
    size: ViewportSize = {"width": given.width, "height": given.height}

    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox"]
        )
        for name, (forces_n, puncture_n) in PUSHES_N.items():
            eye = Path(folder, f"eye{name}")
            sf.phantom(
                eye,
                mechanics="finite-strain",
                globe="open",
                thickness_m=750e-6,
                forces_n=forces_n,
                motion=sf.Motion(
                    rate_hz=60.0, ramp_n_per_s=6e-3, hold_s=1.5, puncture_n=puncture_n
                ),
            )

            with real_monitor(
                given.model, eye, "--web-port", "0", "--eye", "eye-a", pinned=False
            ) as monitor:
                light, dark = (
                    browser.new_page(
                        viewport=size, color_scheme=scheme, bypass_csp=True
                    )
                    for scheme in ("light", "dark")
                )
                for page in (light, dark):
                    page.goto(monitor.console)

                replay = subprocess.Popen(
                    [
                        *COMMAND,
                        "replay",
                        str(eye),
                        "--port",
                        str(monitor.port),
                        "--preload",
                    ],
                    stdout=subprocess.DEVNULL,
                )

                if puncture_n:
                    shoot(dark, NEAR, given.out.with_stem(f"{given.out.stem}-watching"))

                shoot(
                    light,
                    PIERCED if puncture_n else WITHDRAWN,
                    given.out.with_stem(given.out.stem + name),
                )
                replay.wait()

            light.close()
            dark.close()


def shoot(page: Page, when: str, path: Path) -> None:
    """Keep a picture as soon as the page shows something, with as few colours as a PNG
    needs; print what it says.
    """
    page.wait_for_function(when, timeout=WAIT_MS)
    page.screenshot(path=path)
    shown = cv2.imread(str(path))
    assert shown is not None
    cv2.imwrite(str(path), shown, (cv2.IMWRITE_PNG_COMPRESSION, 9))
    texts = (
        page.text_content(f"#{name}") or ""
        for name in ("sentence", "force", "interval", "until-text")
    )
    print(f"{path.name}: {'; '.join(texts)}", flush=True)


if __name__ == "__main__":
    main()
