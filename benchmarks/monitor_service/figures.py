"""Figures of the benchmarks: quantiles, tables, and the progress of a run."""

import sys
from collections.abc import Iterable, Sequence
from time import monotonic

import numpy as np

QUANTILES = ("n", "median", "99 %", "99.9 %", "max")
RENEW_S = 0.5
BAR = 30


def quantiles(values: Iterable[float]) -> dict[str, float | int | None]:
    """Return number, median, 99 %, 99.9 % and maximum; None where there is nothing."""
    found = np.fromiter(values, dtype=np.float64)
    if not len(found):
        return dict.fromkeys(QUANTILES, None) | {"n": 0}

    middle, high, higher = np.quantile(found, (0.5, 0.99, 0.999)).tolist()
    return dict(
        zip(
            QUANTILES,
            (len(found), middle, high, higher, float(found.max())),
            strict=True,
        )
    )


def quantiles_ms(values_s: Iterable[float]) -> dict[str, float | int | None]:
    """Return the same in ms, of times in s."""
    return quantiles(1e3 * value_s for value_s in values_s)


def print_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]
) -> None:
    """Print a table; numbers to the right."""
    cells = [
        list(map(_cell, columns)),
        *([_cell(value) for value in row] for row in rows),
    ]
    widths = [max(len(row[place]) for row in cells) for place in range(len(columns))]
    left = [
        all(isinstance(row[place], str) for row in rows)
        for place in range(len(columns))
    ]
    print(f"\n{title}")

    for row in cells:
        aligned = [
            cell.ljust(width) if is_left else cell.rjust(width)
            for cell, width, is_left in zip(row, widths, left, strict=True)
        ]
        print("  " + "  ".join(aligned).rstrip())

    sys.stdout.flush()


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


class Progress:
    """A bar on a terminal; nothing elsewhere."""

    def __init__(self, name: str, total: int) -> None:
        self._name = name
        self._total = max(total, 1)
        self._begun_s = monotonic()
        self._renewed_s = 0.0
        self._live = sys.stderr.isatty()

    def show(self, done: int, words: str = "") -> None:
        """Show how much is done; cheap to call often."""
        now_s = monotonic()
        if not self._live or (now_s - self._renewed_s < RENEW_S and done < self._total):
            return

        self._renewed_s = now_s
        share = min(1.0, done / self._total)
        left_s = (now_s - self._begun_s) * (1.0 - share) / share if share else 0.0
        bar = "#" * round(BAR * share)
        sys.stderr.write(
            f"\r\x1b[K{self._name} [{bar:<{BAR}}] {done}/{self._total}, {left_s:.0f} s"
            f" left {words}"
        )
        sys.stderr.flush()

    def end(self) -> None:
        """Leave the line."""
        if self._live:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
