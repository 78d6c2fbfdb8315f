"""Settings of Sphinx for these pages: `make docs` builds them to out/site, warnings are
errors, nothing is fetched.
"""

import subprocess
import sys
from importlib.metadata import version as installed_version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "scleraforce"
author = "the scleraforce authors"
version = release = installed_version("scleraforce")
project_copyright = author
try:  # every page says which commit it describes
    git = [
        "git",
        "log",
        "-1",
        "--abbrev=8",
        f"--format=%cs (scleraforce {version}, commit %h)",
    ]
    html_last_updated_fmt = subprocess.run(
        git, check=True, capture_output=True, text=True
    ).stdout.strip()
except (OSError, subprocess.CalledProcessError):  # not a clone
    html_last_updated_fmt = f"%Y-%m-%d (scleraforce {version})"

extensions = [
    *("myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_click"),
    *(
        "commands",
        "excerpts",
        "mathml",
        "references",
        "state_table",
    ),  # of the folder `extensions`
]
exclude_patterns = ["extensions"]
default_role = "code"  # `name` in a docstring
nitpicky = True  # an unresolved reference is an error
# Types of other packages (their inventories would have to be fetched), and private
# types of ours.
nitpick_ignore_regex = [
    (
        "py:class",
        r"(numpy|dataclasses|pathlib|collections|contextlib|msgspec|os)\..*|PathLike|[\d.]+",
    ),
    (
        "py:class",
        r"scleraforce\.calibration\.(filter\.eye_filter|stiffness_from_forces)\..*",
    ),
    (
        "py:class",
        r"scleraforce\.(records\.verdict\.Verdict|wall\.wall_network\.WallFinder)"
        r"|scleraforce\.library\.sealed_eye\._WallLibrary",
    ),
    (
        "py:class",
        r"scleraforce\.(reading\.force_trend\.TimeToBound|records\.globe\.PressureLaw)",
    ),
    ("py:class", r"scleraforce\.reading\.needle_place\.NeedlePlace"),
    ("py:class", r"scleraforce\.fit\.frames_of_an_eye\.DeclaredErrors"),
    ("py:class", r"GivenCalibration|Mask"),
    ("py:class", r"scleraforce\.records\.tissue_relaxation\.(Relaxation|HoldFinding)"),
    ("py:class", r"scleraforce\.recordings\.drawn_walls\.RecordedWalls"),
    ("py:class", r"scleraforce\.library\.(response_splines|stiffened_walls)\..*"),
]

# The notebooks are committed without outputs; the build runs them, in folders that are
# then removed.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300  # seconds a cell
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True

html_theme = "furo"
html_title = "scleraforce"
html_math_renderer = "mathml"  # drawn by the browser: MathJax would be fetched
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_theme_options = {
    "announcement": "Research use only: not a medical device.",
    "light_css_variables": {
        "color-brand-primary": "#0072B2",
        "color-brand-content": "#0072B2",
    },
    "dark_css_variables": {
        "color-brand-primary": "#56B4E9",
        "color-brand-content": "#56B4E9",
    },
}
