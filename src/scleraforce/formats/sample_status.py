"""Which samples of a log their sensor calls faulty: columns of flags, as makers write them."""

import re
from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import RecordingError

STATUS = "status"  # our name of such a column
# How a column is read: ATI's status word, a flag of faults, a flag of validity. "any": all samples are taken.
STATUS_MEANINGS = ATI, GOOD_IF_ZERO, GOOD_IF_SET, ANY = "ati", "zero", "set", "any"
# Bits of ATI's status word (Net F/T, Axia) that leave the force valid: the summary, which repeats the others, and a
# latched condition of the user's own monitor (a threshold).
ATI_HARMLESS = 0x80010000
OF_SENSOR = (
    r"((is|sensor|ft|f/t|f_t|f[xyz]|m[xyz]|force|wrench|torque|device|data|sample|measurement|measured|reading|bota|ati|"
    r"rdt|daq|adc|amp|cable|gage|gauge|transducer)[ _-]*)*"
)
FAULTS = re.compile(
    OF_SENSOR + r"(status|error|fault|over[ _-]?load(ed)?|over[ _-]?range|over[ _-]?flow|saturat(ed|ion)|clipp(ed|ing)|"
    r"invalid|alarm|out[ _-]of[ _-]range|disconnected)[ _-]*(code|word|flags?|bits?|register)?"
)
VALIDITY = re.compile(OF_SENSOR + r"(valid|validity|ok|good|healthy)([ _-]*flag)?")
HEX = re.compile(r"[ _-]*[\[(]?hex\w*[\])]?$", re.IGNORECASE)
CLEAR_WORDS = {"", "ok", "good", "valid", "normal", "none", "false", "no", "no error", "f", "n"}
SET_WORDS = {"ok", "good", "valid", "normal", "true", "yes", "t", "y"}


def status_meaning(name: str, others: Sequence[str]) -> str | None:
    """Return how a column of flags is read, by its name; None where it is not one.

    >>> status_meaning("Status (hex)", ["RDT Sequence"]), status_meaning("is_valid", []), status_meaning("Fz [N]", [])
    ('ati', 'set', None)
    """
    bare = HEX.sub("", name.strip().lower())
    if FAULTS.fullmatch(bare):
        of_ati = bare != name.strip().lower() and any("sequence" in other.lower() for other in others)
        return ATI if of_ati else GOOD_IF_ZERO
    return GOOD_IF_SET if VALIDITY.fullmatch(bare) else None


def faulty_samples(
    name: str, meaning: str, texts: NDArray[np.str_], place: Callable[[int], str]
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Return which samples are no forces, by a column of flags, and sentences on it.

    Args:
        name: of the column.
        meaning: how it is read; see `status_meaning`.
        texts: its fields.
        place: where the line of a sample stands, for messages.

    Raises:
        RecordingError: all samples are faulty.
    """
    none = np.zeros(len(texts), dtype=bool)
    values, index = np.unique(np.char.strip(texts), return_inverse=True)
    if meaning == ANY:
        return none, ()
    in_hex = bool(HEX.search(name.strip()))
    codes = [_code(str(value), in_hex) for value in values]
    if any(isinstance(code, float) for code in codes):  # a measured quantity, like the error of a position
        return none, (f"{name}: not taken for the sensor's status, because it has fractions",)
    faulty = np.array([_is_faulty(code, meaning) for code in codes])[index]
    count = int(faulty.sum())
    if count == len(faulty):
        raise RecordingError(
            f"{place(0)}: {name}: {str(values[index[0]])!r}, and every sample is flagged: the sensor gave no force; if "
            f"this column is not its status, give --column {STATUS}={name}:{ANY}"
        )
    if count:
        first = int(np.argmax(faulty))
        return faulty, (
            f"{name}: {count} of {len(faulty)} samples are flagged by the sensor and have no force; the first is "
            f"{place(first)}: {values[index[first]]}",
        )
    harmless = sorted({str(value) for value, code in zip(values, codes, strict=True) if meaning == ATI and code})
    note = f"{name}: {', '.join(harmless)}: a summary or the user's own threshold, without a fault; its forces are kept"
    return faulty, (note,) if harmless else ()


def _code(text: str, in_hex: bool) -> int | float | str:
    """Return a flag's number, or its word in lower case."""
    try:
        if in_hex or text.lower().startswith("0x"):
            return int(text, 16)
        value = float(text.replace(",", "."))
        return int(value) if value.is_integer() else value if isfinite(value) else text.lower()
    except (ValueError, OverflowError):
        return text.lower()


def _is_faulty(code: int | float | str, meaning: str) -> bool:
    if meaning == GOOD_IF_SET:
        return code not in SET_WORDS if isinstance(code, str) else code == 0
    if isinstance(code, str):
        return code not in CLEAR_WORDS
    return bool(int(code) & ~ATI_HARMLESS) if meaning == ATI else code != 0
