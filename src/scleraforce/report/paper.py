"""What Mendizabal, Sznitman and Cotin (2020) report, to stand beside what was computed here."""

from dataclasses import KW_ONLY, dataclass

PAPER_TITLE = "Mendizabal, Sznitman, Cotin: Force classification during robotic interventions (2020)"


@dataclass(frozen=True)
class PaperEye:
    """One eye of the paper: wall thickness and trials in each class (Table 1), Young's modulus (Table 2)."""

    name: str
    _: KW_ONLY
    thickness_m: float
    trials: tuple[int, int, int]
    modulus_pa: float | None
    modulus_sd_pa: float | None


EYES = (
    PaperEye("eye 1", thickness_m=800e-6, trials=(0, 11, 14), modulus_pa=0.27e6, modulus_sd_pa=4.7e3),
    PaperEye("eye 2", thickness_m=500e-6, trials=(1, 2, 2), modulus_pa=0.22e6, modulus_sd_pa=6.7e3),
    PaperEye("eye 3", thickness_m=650e-6, trials=(2, 0, 3), modulus_pa=0.24e6, modulus_sd_pa=3.9e3),
    PaperEye("eye 4", thickness_m=560e-6, trials=(2, 1, 2), modulus_pa=0.29e6, modulus_sd_pa=4.9e3),
    PaperEye("eye 5", thickness_m=800e-6, trials=(2, 1, 2), modulus_pa=None, modulus_sd_pa=None),
)

MEAN_MODULUS_PA = 0.25e6  # sec. 3.2, for all eyes

CONFUSION = ((5, 2, 0), (0, 14, 1), (0, 0, 23))  # Table 3, rows are targets

SECONDS_A_SLICE = 0.47  # sec. 3.3: 19,200 images in two and a half hours
