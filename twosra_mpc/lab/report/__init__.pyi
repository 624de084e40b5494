from twosra_mpc.lab.report.page import Origin as Origin
from twosra_mpc.lab.report.page import check_report_path as check_report_path
from twosra_mpc.lab.report.page import report_page as report_page
from twosra_mpc.lab.report.page import write_report as write_report
