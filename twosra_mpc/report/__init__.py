"""Reports: one self-contained HTML page about a plan, to read, to send and to plan again from."""

from twosra_mpc.report.page import Origin, check_report_path, report_page, write_report

__all__ = ["Origin", "check_report_path", "report_page", "write_report"]
