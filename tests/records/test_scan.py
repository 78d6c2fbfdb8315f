"""A scan: its sizes, its planes, its file."""

from math import nan

import pytest

from scleraforce.base.errors import InputError, StudyError
from scleraforce.records.scan import Plane, Scan

SIZES = {"columns": 500, "rows": 400, "bits": 12, "width_m": 15e-3, "depth_m": 4e-3}
READERS = {
    "rows": lambda scan: scan.shape,
    "columns": lambda scan: scan.shape,
    "width_m": lambda scan: scan.extent_m,
    "depth_m": lambda scan: scan.extent_m,
    "bits": lambda scan: scan.pixel_bits,
}


@pytest.mark.parametrize("missing", READERS)
def test_a_size_that_is_not_declared_is_named_where_it_is_needed(missing):
    scan = Scan(**{name: SIZES[name] for name in SIZES if name != missing})
    with pytest.raises(InputError, match=f"^scan: {missing}: not declared; give it$"):
        READERS[missing](scan)
    if missing != "bits":
        with pytest.raises(InputError, match=f"^scan: {missing}: not declared"):
            _ = scan.scale


PLANES = (Plane("along", 0.0, 0.0), Plane("across", 0.0, 1.5))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"columns": 15}, "columns: 15 is below the smallest allowed value 16"),
        ({"rows": 16385}, "rows: 16385 is above the largest allowed value 16384"),
        ({"bits": 17}, "bits: 17 is above the largest allowed value 16"),
        ({"width_m": 15.0}, "width_m: 15 is above .*; did you mean 0.015 m"),
        ({"depth_m": nan}, "depth_m: nan is not a finite number"),
        ({"direction_rad": 7.0}, "direction_rad: 7 is above"),
        ({"tilt_rad": 1.1}, "tilt_rad: 1.1 is above"),
        ({"refractive_index": 0.9}, "refractive_index: 0.9 is below .* 1"),
        ({"refractive_index": 2.1}, "refractive_index: 2.1 is above .* 2"),
    ],
)
def test_a_value_of_a_scan_that_cannot_be_is_refused(values, said):
    with pytest.raises(StudyError, match=f"^{said}"):
        Scan(**values)
