"""The page of the report on the paper: one HTML document that needs nothing else."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from pathlib import Path

from twosra_mpc.files import data_file, environment
from twosra_mpc.lab.paper.claims import Verdict
from twosra_mpc.lab.paper.section import Section
from twosra_mpc.report.page import policy, versions

_FOLDER = "lab/paper"
# Everything that the paper shows -> where it is in this report, or why it is not.
SHOWN = (
    ("Fig. 1, 2", "the robot and its geometry", "drawings: nothing to compute"),
    ("Fig. 3, Table I", "paths of the units and their spirals", "paths"),
    ("Fig. 4", "geometry of a spiral, control strategy", "drawings: nothing to compute"),
    ("Fig. 5(a)", "set-up of the trials", "a photograph"),
    ("Fig. 5(b)", "forward kinematics against the planner", "statistics"),
    ("Fig. 6(a)", "the five tasks", "tasks"),
    ("Fig. 6(b-d)", "segment in thermal photographs", "curvature"),
    ("Fig. 7(a-c)", "trials against simulations", "trials"),
    ("Fig. 7(d)", "curvature along the segment", "curvature"),
    ("Fig. 8", "two applications", "applications"),
    ("Table II", "comparison with other robots", "properties in words: nothing to compute"),
)


def paper_page(sections: Sequence[Section], verdicts: Mapping[Verdict, int], folder: Path) -> str:
    """Return the report as one HTML document.

    Args:
        sections: Its sections, in order.
        verdicts: How many claims have which verdict.
        folder: Where the figures are.
    """
    style = data_file("report/page.css") + data_file(f"{_FOLDER}/paper.css")
    return (
        environment(_FOLDER)
        .get_template("paper.html")
        .render(
            policy=policy(style, ""),
            style=style,
            sections=sections,
            titles={section.name: section.title for section in sections},
            verdicts={one.value: count for one, count in verdicts.items()},
            look={one.value: one.name.lower() for one in Verdict},
            shown=SHOWN,
            versions=versions(None),
            pictures={
                picture.file: b64encode((folder / picture.file).read_bytes()).decode()
                for section in sections
                for picture in section.pictures
            },
        )
    )
