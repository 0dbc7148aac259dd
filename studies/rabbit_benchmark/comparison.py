"""Methods compared on the same courses: McNemar's exact test, Holm's correction, and the difference's interval."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from scipy import stats


@dataclass(frozen=True)
class Paired:
    """Courses that one of two methods alone walked, and the two-sided probability of such a difference by chance."""

    courses: int
    only_this: int
    only_other: int

    @property
    def p_value(self) -> float:
        """The p-value of the sign test: each discordant course is as likely to be the one's as the other's."""
        discordant = self.only_this + self.only_other
        return float(stats.binomtest(self.only_this, discordant).pvalue) if discordant else 1.0

    @property
    def difference(self) -> tuple[float, float, float]:
        """Share that this one walks more, and its 95% interval by Agresti and Min (2005), Wald's with half a course
        added to each of the four cells of the table."""
        n, more, either = self.courses + 2, self.only_this - self.only_other, self.only_this + self.only_other + 1
        half = 1.96 * sqrt(either - more**2 / n) / n
        return more / self.courses, max(-1.0, more / n - half), min(1.0, more / n + half)


def paired(this: Sequence[bool], other: Sequence[bool]) -> Paired:
    """Two methods on the same courses in the same order."""
    pairs = list(zip(this, other, strict=True))
    return Paired(len(pairs), pairs.count((True, False)), pairs.count((False, True)))


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values (1979), in the order given."""
    order = sorted(range(len(p_values)), key=p_values.__getitem__)
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = largest
    return adjusted


def of_so_many(others: int, walked: int, courses: int) -> tuple[int, int]:
    """Between how many of so many `others` are walked with a probability of 95%, where `walked` of `courses` were.

    The beta-binomial distribution, from Jeffreys' prior of the share walked.
    """
    distribution = stats.betabinom(others, walked + 0.5, courses - walked + 0.5)
    return int(distribution.ppf(0.025)), int(distribution.ppf(0.975))
