"""A solver that looks at the clock: IPOPT asks after every iteration whether it may go on."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from twosra_mpc.deadline import overtime_left_s


class Stopping(ca.Callback):
    """Stops a solver when the time limit of whoever called it is over."""

    def __init__(self, nlp: dict[str, ca.MX]) -> None:
        """For a program with these symbols x and expressions g."""
        ca.Callback.__init__(self)
        self._sizes = {"f": 1, "x": nlp["x"].numel(), "g": nlp["g"].numel()}
        self.construct("stopping", {})

    def get_n_in(self) -> int:
        """As CasADi asks."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """As CasADi asks."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """As CasADi asks."""
        return ca.Sparsity.dense(self._sizes.get(ca.nlpsol_out(i).removeprefix("lam_"), 0), 1)

    def eval(self, _: Sequence[ca.DM]) -> list[int]:
        """Whether to stop."""
        return [int(overtime_left_s() < 0.0)]
