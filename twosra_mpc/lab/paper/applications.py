"""The paper's two applications, planned as missions."""

from __future__ import annotations

from pathlib import Path

from twosra_mpc import Status, load_problem, plan
from twosra_mpc.lab.paper.section import Claim, Data, Reading, Section, Tell, declared
from twosra_mpc.plotting import plot_plan

SCENARIOS = {"conform-cylinder": "conform to a cylinder", "grasp-cube": "grip a cube and move it"}


def compute(folder: Path, tell: Tell) -> Data:
    """Plan both, with figures."""
    data: Data = {}
    for name in SCENARIOS:
        tell(f"planning {name}")
        found = plan(load_problem(name))
        data[name] = {"status": str(found.status), "message": found.message}
        if found.plan is None:
            continue
        plot_plan(found.plan, folder / f"{name}.png")
        data[name] |= {
            "sequence": found.plan.sequence,
            "duration_s": found.plan.duration_s,
            "gap": found.plan.search_gap,
        }
    return data


_IN_THE_MODEL = "In the model: no object was touched."


def section(data: Data) -> Section:
    """Say whether there is a verified plan of each."""
    planned = {name: one for name, one in data.items() if "sequence" in one}
    claims = [
        Claim(
            f"The robot can {words}",
            "Fig. 8",
            (Reading("verified plans", 1.0, float(name in planned), "", 0.0, 0.0),),
            _IN_THE_MODEL if name in planned else data[name]["message"],
            undecided=data[name]["status"] == Status.FAILED,
        )
        for name, words in SCENARIOS.items()
    ]
    lines = [{**one, "name": name} for name, one in planned.items()]
    return declared(
        "applications",
        data,
        (lines,),
        [f"{name}.png" for name in planned],
        others=claims,
    )
