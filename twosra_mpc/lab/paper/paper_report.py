"""The report on the paper: numbers and figures of each section, one page and one JSON file.

What is compared is Labazanova et al., "Self-Reconfigurable Soft-Rigid Mobile Agent with Variable
Stiffness and Adaptive Morphology", IEEE RA-L 2023, doi 10.1109/LRA.2023.3241749.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.files import data_file, environment, plain_data, write_json, write_text
from twosra_mpc.installation import __version__
from twosra_mpc.lab.paper import (
    applications,
    equations,
    photographs,
    published_tasks,
    statistics,
    trials,
    unit_paths,
)
from twosra_mpc.lab.paper.section import PAPER, Data, Section, Tell, Verdict, declared
from twosra_mpc.lab.photographs.picture import PAPER_CAMERA, Camera
from twosra_mpc.lab.report.page import policy, versions

PAGE, NUMBERS = "report.html", "numbers.json"


@public
@dataclass(frozen=True)
class Sources:
    """Sources of the report besides the package; None is not given.

    Attributes:
        logs: Folder of logs of trials (CSV).
        photographs: Folder of folders of photographs, a CSV file of references beside each.
        simulations: CSV file of recorded simulations.
        column: Column of the references [1/m].
        camera: How the photographs were taken.
    """

    logs: Path | None = None
    photographs: Path | None = None
    simulations: Path | None = None
    column: str = "k1"
    camera: Camera = PAPER_CAMERA


@dataclass(frozen=True)
class PaperReport:
    """All sections, with the data that they were made of."""

    sections: tuple[Section, ...]
    data: Data

    @property
    def verdicts(self) -> dict[Verdict, int]:
        """Number of claims by verdict."""
        found = [claim.verdict for section in self.sections for claim in section.claims]
        return {verdict: found.count(verdict) for verdict in Verdict}

    def document(self) -> Data:
        """Everything as plain data: verdicts, claims and numbers by section."""
        return plain_data(
            {
                "version": __version__,
                "verdicts": self.verdicts,
                "claims": [
                    {"section": section.name, **claim.document()}
                    for section in self.sections
                    for claim in section.claims
                ],
                "missing": {one.name: one.missing for one in self.sections if one.missing},
                "numbers": self.data,
            }
        )


@public
def reproduce(
    folder: str | Path,
    sources: Sources = Sources(),
    *,
    problems: int = 100,
    tell: Tell = lambda _: None,
) -> PaperReport:
    """Compare the paper with what comes of it here; write the page, its figures and all numbers.

    Args:
        folder: Where to; it is made if its parent exists.
        sources: Logs, photographs and simulations, as far as there are any.
        problems: Random problems of each kind; the paper had 100.
        tell: Is told what is being done.

    Raises:
        InputError: If a source is not acceptable, or the folder cannot be written.
    """
    if problems < 1:
        raise InputError("problems", problems, "1 or more")
    to = _made(Path(folder)), tell
    found: Data = {}
    # What the user gave comes first: mistakes in it are told before all other work.
    if sources.logs is not None:
        found["trials"] = trials.compute(*to, sources.logs)
    if (pictures := sources.photographs) is not None:
        found["curvature"] = photographs.compute(*to, pictures, sources.column, sources.camera)
    found["tasks"] = published_tasks.compute(*to, sources.simulations)
    found["paths"] = unit_paths.compute(*to)
    found["equations"] = equations.compute(*to)
    found["applications"] = applications.compute(*to)
    found["statistics"] = statistics.compute(*to, problems)
    data: Data = plain_data(found)
    report = PaperReport(
        (
            unit_paths.section(data["paths"]),
            declared("equations", data["equations"]),
            published_tasks.section(data["tasks"]),
            declared("statistics", data["statistics"], pictures=(statistics.FIGURE,)),
            photographs.section(data.get("curvature")),
            trials.section(data.get("trials")),
            applications.section(data["applications"]),
        ),
        data,
    )
    tell("writing the page")
    write_json(Path(folder) / NUMBERS, report.document())
    write_text(Path(folder) / PAGE, paper_page(report.sections, report.verdicts, Path(folder)))
    return report


def _made(folder: Path) -> Path:
    """Make a folder if there is none."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        allowed = f"a folder, or a name in one that can be written ({error.strerror})"
        raise InputError("output", str(folder), allowed) from error
    return folder


_FOLDER = "lab/paper"


def paper_page(sections: Sequence[Section], verdicts: Mapping[Verdict, int], folder: Path) -> str:
    """Return the report as one HTML document.

    Args:
        sections: Its sections, in order.
        verdicts: How many claims have which verdict.
        folder: Where the figures are.
    """
    style = data_file("lab/report/page.css") + data_file(f"{_FOLDER}/paper.css")
    names = [picture.file for section in sections for picture in section.pictures]
    page = environment(_FOLDER).get_template("paper.html")
    return page.render(
        policy=policy(style, ""),
        style=style,
        sections=sections,
        titles={section.name: section.title for section in sections},
        verdicts={one.value: count for one, count in verdicts.items()},
        look={one.value: one.name.lower() for one in Verdict},
        shown=PAPER["shown"],
        versions=versions(None),
        pictures={name: b64encode((folder / name).read_bytes()).decode() for name in names},
    )
