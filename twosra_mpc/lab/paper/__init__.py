"""The report on the paper: its figures, tables and claims beside what comes of them here."""

from twosra_mpc.lab.paper.paper_report import PaperReport, Sources, reproduce
from twosra_mpc.lab.paper.section import Claim, Reading, Verdict

__all__ = ["Claim", "PaperReport", "Reading", "Sources", "Verdict", "reproduce"]
