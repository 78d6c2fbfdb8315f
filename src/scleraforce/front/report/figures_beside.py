"""Figures of a page, encoded by a second process while this one draws the next ones."""

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from matplotlib.figure import Figure

from scleraforce.base.worker_processes import finished_result, work_beside
from scleraforce.front.report.figure_files import EncodedFigure, encode_figure


class FigureEncoder:
    """Encodes the figures among the values of a page in a second process."""

    def __init__(
        self, submit: Callable[[int], "Future[EncodedFigure]"], folder: Path
    ) -> None:
        self._submit = submit
        self._folder = folder
        self._numbers = count()

    def begin(self, value: Any) -> Any:
        """Return a value, with figures in it, also in lists, as the promise of their
        encoding.
        """
        if isinstance(value, list | tuple):
            return type(value)(map(self.begin, value))
        if not isinstance(value, Figure):
            return value

        number = next(self._numbers)
        _figure_file(self._folder, number).write_bytes(pickle.dumps(value))
        return self._submit(number)

    def finish(self, value: Any) -> Any:
        """Return a value of `begin` with encoded figures."""
        if isinstance(value, list | tuple):
            return type(value)(map(self.finish, value))
        return finished_result(value) if isinstance(value, Future) else value


@contextmanager
def figure_encoder() -> Iterator[FigureEncoder]:
    """Give an encoder, whose process ends with the block."""
    with TemporaryDirectory(prefix="scleraforce-") as name:
        folder = Path(name)
        # gives the function of a figure's number
        with work_beside(partial(partial, _encode, folder)) as submit:
            yield FigureEncoder(submit, folder)


def _encode(folder: Path, number: int) -> EncodedFigure:
    return encode_figure(pickle.loads(_figure_file(folder, number).read_bytes()))


def _figure_file(folder: Path, number: int) -> Path:
    return folder / f"{number}.pickle"
