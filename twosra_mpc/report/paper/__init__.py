"""The report on the paper: its figures, tables and claims beside what comes of them here."""

from twosra_mpc.report.paper.claims import Claim, Reading, Verdict
from twosra_mpc.report.paper.report import PaperReport, Sources, reproduce

__all__ = ["Claim", "PaperReport", "Reading", "Sources", "Verdict", "reproduce"]
