"""What nobody knows of a robot before trying: where segments end that bend together."""

from __future__ import annotations

import itertools
from typing import Annotated, NamedTuple

from pydantic import BeforeValidator, Field

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.validation import Share, Value, plain


class JointBend(NamedTuple):
    """One way in which segments that are soft together may bend.

    Attributes:
        split: Share by which the first of them bends more than on average, the second less, the
            third more again.
        relaxation: How much of the difference between their bends is gone when they begin.
    """

    split: float = 0.0
    relaxation: float = 0.0


def evened(bend: JointBend, soft: Array) -> Array:
    """Bending coordinates W (n,) of segments once they are soft together."""
    return soft + bend.relaxation * (soft.mean() - soft)


_Split = Annotated[float, Field(gt=-1.0, lt=1.0)]
_Listed = Field(min_length=1, max_length=16)


class Uncertainty(Value):
    """Uncertainty about joint bends: the values of each list are equally likely, whatever others.

    Attributes:
        joint_splits: Share by which the first of segments that are soft together bends more than
            on average, and the second less.
        joint_relaxations: Share of the difference between their bends that is lost, as springs
            like equal bends.
    """

    joint_splits: Annotated[tuple[_Split, ...], _Listed, BeforeValidator(plain)] = (0.0,)
    joint_relaxations: Annotated[tuple[Share, ...], _Listed, BeforeValidator(plain)] = (0.0,)

    @property
    def joint_bends(self) -> tuple[JointBend, ...]:
        """Every way in which joint bends may come out; all are equally likely."""
        each = itertools.product(self.joint_splits, self.joint_relaxations)
        return tuple(itertools.starmap(JointBend, each))
