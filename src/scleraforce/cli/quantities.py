"""The type of an option that states a quantity of an eye: a number with the bounds of `study.fields.QUANTITIES`."""

import click

from scleraforce.errors import StudyError
from scleraforce.study.fields import allowed, check_quantity


class Possible(click.FloatRange):
    """A number that a quantity can have, in the unit of its key; another one is refused with what may have been meant.

    >>> Possible("thickness_um").convert("650", None, None)
    650.0
    """

    def __init__(self, key: str) -> None:
        bounds = allowed(key)
        super().__init__(bounds.low, bounds.high)
        self._key = key

    def convert(self, value: str | float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        try:
            number = float(value)
            check_quantity(self._key, number)
        except ValueError:
            self.fail(f"{value!r} is not a valid float.", param, ctx)
        except StudyError as fault:
            self.fail(str(fault).partition(": ")[2], param, ctx)
        return number
