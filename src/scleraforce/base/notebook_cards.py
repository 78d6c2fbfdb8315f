"""Frames as grey pictures, and results as HTML for Jupyter: text and a picture, without
scripts or network.
"""

from base64 import b64encode
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Bytes
from scleraforce.base.optional_packages import package_for
from scleraforce.base.plain_json import finite_json

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


Row = dict[str, Any]

# Lists of two numbers, and the columns that they become.
PAIRS = {
    "interval_mn": ("interval_low_mn", "interval_high_mn"),
    "tip_mm": ("tip_lateral_mm", "tip_depth_mm"),
}


def flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row whose lists and objects are columns of their own, by the names of
    `ANSWER_DEFINITION`.

    >>> flat({"file": "a.png", "interval_mn": [1.0, 2.0], "probabilities": [1.0]})
    ... # doctest: +NORMALIZE_WHITESPACE
    {'file': 'a.png', 'interval_low_mn': 1.0, 'interval_high_mn': 2.0,
     'probabilities_0': 1.0}
    >>> flat({"needle": {"tip_mm": [0.5, 3.0]}})
    {'needle_tip_lateral_mm': 0.5, 'needle_tip_depth_mm': 3.0}
    >>> flat({"dent_mm": 1.0, "dent_mm_interval": [0.9, 1.1]})
    {'dent_mm': 1.0, 'dent_mm_low': 0.9, 'dent_mm_high': 1.1}
    """
    columns: dict[str, Any] = {}
    for key, value in row.items():
        if key in PAIRS or key.endswith("_interval"):
            names = PAIRS.get(key) or tuple(
                key.replace("_interval", end) for end in ("_low", "_high")
            )
            columns |= zip(
                names, value if isinstance(value, list) else (None, None), strict=False
            )
        elif isinstance(value, Mapping | list):
            inner = dict(enumerate(value)) if isinstance(value, list) else value
            columns |= {
                f"{key}_{name}": entry
                for name, entry in flat({str(n): v for n, v in inner.items()}).items()
            }
        else:
            columns[key] = value

    return columns


def data_frame(rows: Iterable[Mapping[str, Any]]) -> Any:
    """Return rows as a table of pandas, with the columns of `flat`; raises `InputError`
    without pandas.
    """
    return package_for("pandas", "a DataFrame", "tables").DataFrame(
        tidy(map(finite_json, rows))
    )


def tidy(rows: Iterable[Mapping[str, Any]]) -> list[Row]:
    """Return flat rows that all have the same columns, None where a row lacks one."""
    flattened = [flat(row) for row in rows]
    every = dict.fromkeys(name for row in flattened for name in row)
    filled = {
        name for row in flattened for name, value in row.items() if value is not None
    }
    # What is null in one row and an object in another has the object's columns only.
    names = [
        name
        for name in every
        if name in filled or not any(other.startswith(f"{name}_") for other in every)
    ]

    return [{name: row.get(name) for name in names} for row in flattened]
