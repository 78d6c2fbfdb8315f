"""The console of a real monitor in headless Chromium: docs/images/console*.png.

PYTHONPATH=benchmarks python -m screenshots.console

A virtual needle pushes to 36 mN (console: the withdrawal), and in another session
through the wall at 22 mN. There the bound comes nearer (console-watching, in the dark
scheme), and the puncture is found (console-pierced). On a busy machine frames come too
late, and the pictures show that instead: look at them.
"""

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Page, ViewportSize

import scleraforce as sf
from monitor.browser import chromium, keep_picture
from monitor.real_monitor import real_monitor, scleraforce
from scleraforce.records.model_folder import SHIPPED_READER

PUSHES_N = {"": ([12e-3, 6e-3, 36e-3], None), "-pierced": ([12e-3, 6e-3, 20e-3], 22e-3)}
WAIT_MS = 120_000.0
SIZE: ViewportSize = {"width": 1280, "height": 720}
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
    with TemporaryDirectory() as folder, chromium() as browser:
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
                SHIPPED_READER, eye, "--web-port", "0", "--eye", "eye-a", pinned=False
            ) as monitor:
                light, dark = (
                    browser.new_page(
                        viewport=SIZE, color_scheme=scheme, bypass_csp=True
                    )
                    for scheme in ("light", "dark")
                )
                for page in (light, dark):
                    page.goto(monitor.console)

                replay = subprocess.Popen(
                    scleraforce(
                        "replay", str(eye), "--port", str(monitor.port), "--preload"
                    ),
                    stdout=subprocess.DEVNULL,
                )

                if puncture_n:
                    shoot(dark, NEAR, "console-watching")

                shoot(light, PIERCED if puncture_n else WITHDRAWN, f"console{name}")
                replay.wait()

            light.close()
            dark.close()


def shoot(page: Page, when: str, name: str) -> None:
    """Keep a picture as soon as the page shows something; print what it says."""
    page.wait_for_function(when, timeout=WAIT_MS)
    keep_picture(page, name)
    texts = (
        page.text_content(f"#{part}") or ""
        for part in ("sentence", "force", "interval", "until-text")
    )
    print(f"{name}: {'; '.join(texts)}", flush=True)


if __name__ == "__main__":
    main()
