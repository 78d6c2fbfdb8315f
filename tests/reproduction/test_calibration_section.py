"""The table of moduli of the reproduction has what was found beside them, where anything was."""

import re
from dataclasses import replace

from calibrated_eye import calibration_of_a_sealed_eye

from scleraforce.report.html import NOTHING
from scleraforce.reproduction.sections import _table_2


def rows_of(html: str) -> dict[str, list[str]]:
    rows = [re.findall(r"<t[hd][^>]*>([^<]*)", row) for row in re.findall(r"<tr>.*?</tr>", html)]
    return {row[0]: row[1:] for row in rows}


def test_the_rigidity_of_a_sealed_eye_has_a_row_and_an_eye_of_which_e_alone_was_found_has_nothing_there() -> None:
    calibration = calibration_of_a_sealed_eye()
    sealed = calibration.eyes["mine"]
    alone = {"names": sealed.names[:1], "means": sealed.means[:1], "sds": sealed.sds[:1], "discrepancy": None}
    plain = replace(sealed, id="plain", **alone)
    both = rows_of(_table_2(replace(calibration, eyes={"mine": sealed, "plain": plain})))
    found, nothing = both["found with it"]
    assert found.startswith("thickness 651 ± 12 µm; k 0.031 ± 0.001 mmHg^(1/3)/µl; forces 13 ± 3 % above")
    assert nothing == NOTHING
    assert "found with it" not in rows_of(_table_2(replace(calibration, eyes={"plain": plain})))
