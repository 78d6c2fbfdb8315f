"""Frames as grey pictures, and results as HTML for Jupyter: text and a picture, without
scripts or network.
"""

from base64 import b64encode
from collections.abc import Mapping
from html import escape
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.arrays import Bytes

# percentiles of the pixels that are lit
DARKEST = 1.0
BRIGHTEST = 99.7
WIDEST_PX = 512  # of a picture in a notebook


def grey_picture(pixels: NDArray[Any]) -> Bytes:
    """Return a frame (row, column) as a grey picture, stretched between percentiles of
    its lit pixels.
    """
    lit = pixels[pixels > 0]
    low, high = np.percentile(lit, [DARKEST, BRIGHTEST]) if len(lit) else (0.0, 1.0)
    return np.clip((pixels - low) * (255.0 / max(high - low, 1.0)), 0, 255).astype(
        np.uint8
    )


def html_card(
    title: str, facts: Mapping[str, str], picture: Bytes | None = None
) -> str:
    """Return a title, a table of facts and a picture, grey or blue-green-red, as HTML
    in the colours of its page.
    """
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td'
        f' style="text-align:left">{escape(fact)}</td></tr>'
        for name, fact in facts.items()
    )
    image = ""

    if picture is not None:
        data = b64encode(bytes(cv2.imencode(".png", picture)[1])).decode()
        style = f"display:block;max-width:100%;width:{WIDEST_PX}px"
        image = (
            f'<img alt="{escape(title)}" style="{style}"'
            f' src="data:image/png;base64,{data}">'
        )

    return f"<div><strong>{escape(title)}</strong>{image}<table>{rows}</table></div>"
