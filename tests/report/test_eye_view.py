"""The wall to be turned: its script has the skin of the mesh, and a browser draws it without a network."""

import base64
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from math import radians
from pathlib import Path

import cv2
import numpy as np
import pytest
from chromium import CHROMIUM, in_chromium
from playwright.sync_api import Page, sync_playwright

from scleraforce.laboratory.virtual_eye import SimulatedEye, simulate_eye
from scleraforce.mechanics.contact import Contact
from scleraforce.report.eye_view import skin_of, write_simulation_html
from scleraforce.study import Study
from scleraforce.study.eye import MeshStudy

CONTACT = Contact(polar_rad=radians(35.0), azimuth_rad=0.3)


@pytest.fixture(scope="module", params=[1, 2])
def eye(request: pytest.FixtureRequest) -> SimulatedEye:
    study = replace(Study(), mesh=MeshStudy(divisions=8, level=0, layers=1, order=request.param))
    return simulate_eye(study, 0.5e-3, 0.02, CONTACT)


def enclosed_volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """Volume within a closed surface whose triangles are counter-clockwise from outside (divergence theorem)."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(np.einsum("tc,tc->", a, np.cross(b, c)) / 6.0)


def test_the_skin_is_closed_looks_outwards_and_follows_the_curved_wall(eye: SimulatedEye) -> None:
    skin = skin_of(eye.mesh.points_nc, eye.displacement_nc, eye.mesh.cells_en)
    edges = np.concatenate([skin.triangles_tn[:, [n, (n + 1) % 3]] for n in range(3)])
    assert {tuple(edge) for edge in edges} == {tuple(edge[::-1]) for edge in edges}
    shell = 2.0 / 3.0 * np.pi * (12e-3**3 - 11.5e-3**3)
    tolerance = {1: 0.05, 2: 0.005}[eye.mesh.order]
    assert enclosed_volume(skin.points_nc, skin.triangles_tn) == pytest.approx(shell, rel=tolerance)
    middles = np.linalg.norm(skin.points_nc[len(eye.mesh.points_nc) :], axis=1)
    outer = middles[middles > 11.8e-3]  # the rim's are between the surfaces
    assert len(outer) == 8 * 8 * 3  # of the half cube: its top, and four halves of sides
    np.testing.assert_allclose(outer, 12e-3, atol=(0.0 if eye.mesh.order == 2 else 0.15e-3) + 2e-6)
    assert np.isfinite(skin.displacement_nc).all()


def test_the_page_is_one_file_that_fetches_nothing(eye: SimulatedEye, tmp_path: Path) -> None:
    write_simulation_html(eye, tmp_path / "eye.html", datetime(2026, 3, 1, tzinfo=UTC))
    text = (tmp_path / "eye.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="(?!data:)', text)
    found = re.search(r'id="eye-scene">(.*?)</script>', text)
    assert found is not None
    assert json.loads(found[1])["radius_mm"] == pytest.approx(12.0)


@pytest.fixture
def opened(eye: SimulatedEye, tmp_path: Path) -> Iterator[Page]:
    write_simulation_html(eye, tmp_path / "eye.html", datetime(2026, 3, 1, tzinfo=UTC))
    with sync_playwright() as playwright:
        # WebGL drawn by the processor.
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        page = browser.new_context(offline=True, viewport={"width": 900, "height": 900}).new_page()
        page.goto((tmp_path / "eye.html").as_uri())
        yield page
        browser.close()


def picture(page: Page) -> np.ndarray:
    content = page.evaluate("document.getElementById('eye').toDataURL('image/png')").partition(",")[2]
    return cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_COLOR).astype(int)


@in_chromium
def test_a_browser_draws_the_wall_and_keys_slider_and_whole_wall_change_it(opened: Page) -> None:
    start = picture(opened)
    covered = (start.sum(axis=2) < 3 * 250).mean()
    assert 0.05 < covered < 0.6
    needle = (start[..., 2] - start[..., 0] > 60) & (start[..., 1] < 120)
    assert needle.sum() > 100
    opened.locator("#eye").press("ArrowRight")
    turned = picture(opened)
    assert np.abs(turned - start).mean() > 1.0
    opened.locator("#eye").press("ArrowLeft")
    assert np.abs(picture(opened) - start).mean() < 0.5
    opened.locator("#eye-whole").check()
    assert (picture(opened).sum(axis=2) < 3 * 250).mean() > 1.1 * covered
    opened.locator("#eye-whole").uncheck()
    opened.locator("#eye-scale").fill("0")
    assert np.abs(picture(opened) - start).mean() > 0.3
    assert opened.locator("#eye-highest").inner_text().endswith("mm")
