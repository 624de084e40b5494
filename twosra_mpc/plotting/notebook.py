"""Plans as notebooks show them."""

from __future__ import annotations

from html import escape

from twosra_mpc.plans.plan import Plan
from twosra_mpc.plotting.figure_file import picture_address
from twosra_mpc.plotting.plan_figure import plan_title, plot_plan


def plan_html(plan: Plan) -> str:
    """Return the figure of a plan as an HTML element that needs no other file."""
    address = picture_address(plot_plan(plan), "png")
    return f'<img src="{address}" alt="{escape(plan_title(plan))}" style="max-width: 100%">'
