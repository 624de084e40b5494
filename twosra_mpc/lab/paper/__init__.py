"""The report on the paper: its figures, tables and claims beside what comes of them here."""

from twosra_mpc.lab.paper.claims import Claim, Reading, Verdict
from twosra_mpc.lab.paper.paper_report import PaperReport, Sources, reproduce

__all__ = ["Claim", "PaperReport", "Reading", "Sources", "Verdict", "reproduce"]
