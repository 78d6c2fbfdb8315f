"""How often something may be done: a rate in the long run, and a burst."""


class Allowance:
    """Allows `per_s` actions a second in the long run, and a burst of `at_once` after a pause.

    >>> allowance = Allowance(per_s=2.0, at_once=3)
    >>> [allowance.take(now_s) for now_s in (10.0, 10.0, 10.0, 10.0, 10.5, 10.6)]
    [True, True, True, False, True, False]
    """

    def __init__(self, per_s: float, at_once: int) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left, self._then_s = float(at_once), -float("inf")

    def take(self, now_s: float) -> bool:
        """Return whether the action is allowed now; if it is, it counts as done."""
        self._left = min(self._at_once, self._left + self._per_s * max(0.0, now_s - self._then_s))
        self._then_s = max(now_s, self._then_s)
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
