from twosra_mpc.lab.figures.atlas_figure import plot_comparison as plot_comparison
from twosra_mpc.lab.figures.atlas_figure import plot_map as plot_map
from twosra_mpc.lab.figures.paper_figures import plot_error_decrease as plot_error_decrease
from twosra_mpc.lab.figures.paper_figures import plot_forward_kinematics as plot_forward_kinematics
from twosra_mpc.lab.figures.paper_figures import plot_published_tasks as plot_published_tasks
