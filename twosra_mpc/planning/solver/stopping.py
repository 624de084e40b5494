"""A solver whose work is counted: IPOPT asks after every iteration whether it may go on."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from twosra_mpc.effort import Cost, OutOfEffortError, charge


class Stopping(ca.Callback):
    """Stops a solver when the effort of whoever called it is over."""

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
        try:
            charge(Cost.NLP_STEP, self._sizes["x"])
        except OutOfEffortError:
            return [1]
        return [0]
