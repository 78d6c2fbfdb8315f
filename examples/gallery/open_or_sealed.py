"""Open or sealed: the same dent, another force.

In an open globe (infused or vented) the pressure is constant. In a sealed one it rises
with the dent (van der Werff 1981), and the same dent takes more force. A sealed eye
that is declared open is read too low.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import scleraforce as sf
from scleraforce.base.units import from_si, to_si
from scleraforce.front.report.figure_files import (
    AMBER,
    BLUE,
    GREY,
    RED,
    inches,
    styled,
    write_figure,
)
from scleraforce.library import sealed_eye
from scleraforce.records.globe import sealed_law

# a small library: made in 15 s, then kept in the cache
QUICK = Path(__file__).parents[2] / "docs" / "quick.toml"
THICKNESS_M = 0.6e-3
MODULUS_PA = 0.45e6
IOP_PA = to_si(2.0, "mmhg")
RIGIDITIES = (
    (0.0, "open", BLUE),
    (0.008, "sealed, k = 0.008", AMBER),
    (0.03, "sealed, k = 0.03", RED),
)


@styled
def draw() -> Figure:
    """Draw force and pressure over the dent for an open globe and two sealed ones (k in
    mmHg^(1/3)/µl).
    """
    library = sf.library_of(sf.read_study(QUICK))
    dent_m = np.linspace(0.0, 2e-3, 81)
    thickness_m = np.full_like(dent_m, THICKNESS_M)
    figure = Figure(figsize=inches(170, 70))
    left, right = figure.subplots(1, 2)

    for rigidity, name, colour in RIGIDITIES:
        # The library knows forces and pressures over E only: so does the globe.
        globe = sealed_law(to_si(rigidity, "mmhg13_per_ul")).over(MODULUS_PA)
        ratio = np.full_like(dent_m, IOP_PA / MODULUS_PA)
        rates = np.full_like(dent_m, globe.rate)
        sealed_eye.pressures_at_dents(
            library.tables, thickness_m, dent_m, rates, False, ratio
        )
        force_n = library.forces(thickness_m, ratio, dent_m) * MODULUS_PA
        left.plot(dent_m * 1e3, force_n * 1e3, color=colour, label=name)
        right.plot(
            dent_m * 1e3, from_si(ratio * MODULUS_PA, "mmhg"), color=colour, label=name
        )

    left.axhline(30.0, color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))
    left.set_ylabel("force [mN]")
    right.set_ylabel("pressure under the needle [mmHg]")
    for axes in (left, right):
        axes.set_xlabel("dent [mm]")

    left.legend()
    return figure


if __name__ == "__main__":
    write_figure(
        draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "open_or_sealed.png")
    )
