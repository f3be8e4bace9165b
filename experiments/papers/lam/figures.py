"""Figures of Lam, Manzie & Good, drawn from a result."""

from matplotlib.figure import Figure

from experiments.papers.lam.claims import curve
from experiments.papers.lam.experiment import CONTROLLERS, Result
from experiments.papers.panels import Curve, Panel, drawn

COLOURS = dict(zip(CONTROLLERS, ("tab:blue", "tab:green", "tab:orange", "tab:red"), strict=True))
TRACE_COLOURS = ("tab:blue", "tab:orange")
MAGNIFIED = 50.0  # contour error in Fig. 8, which else could not be seen


def contour(result: Result) -> Figure:
    """Fig. 8: the path and the tool, the distance between them enlarged."""
    dashed = {"color": "0.3", "linestyle": "--", "linewidth": 0.8}
    curves = [Curve(*result.points_mm.T, "path", dashed)]
    for colour, trace in zip(TRACE_COLOURS, result.traces, strict=True):
        enlarged = trace.foot_mm + MAGNIFIED * (trace.tool_mm - trace.foot_mm)
        style = {"color": colour, "linewidth": 1.0}
        curves.append(Curve(*enlarged.T, f"q_theta = {trace.q_theta:g}", style))
    title = f"Fig. 8: MPCC, contour error x {MAGNIFIED:g}, friction plant"
    return drawn([Panel(title, "x [mm]", "y [mm]", curves, {"aspect": "equal"})], (6.5, 6.5))


def along_the_path(result: Result) -> Figure:
    """Figs 9 to 11: currents, path speed and contour error over the path parameter."""
    curves: dict[str, list[Curve]] = {}
    for colour, trace in zip(TRACE_COLOURS, result.traces, strict=True):
        style = {"color": colour, "linewidth": 0.9}
        signals = {
            "i_x [A]": trace.control_a[:, 0],
            "i_y [A]": trace.control_a[:, 1],
            "path speed [mm/s]": trace.speed_mm_s,
            "contour error [um]": trace.contour_error_um,
        }
        for label, values in signals.items():
            one = Curve(trace.theta_mm, values, f"q_theta = {trace.q_theta:g}", style)
            curves.setdefault(label, []).append(one)
    panels = [Panel("", "", label, both, {"xmargin": 0.01}) for label, both in curves.items()]
    panels[-1].axes["xlabel"] = "path parameter theta [mm]"
    title = "Figs 9, 10, 11: MPCC on the friction plant"
    return drawn(panels, (8.0, 9.0), title, legend=2, sharex=True)


def trade_off(result: Result) -> Figure:
    """Fig. 13: RMS contour error over traversal time, one panel for each plant."""
    panels = []
    for plant in result.plants:
        curves = []
        for controller, colour in COLOURS.items():
            style = {"color": colour, "marker": "o", "markersize": 4, "linewidth": 1.0}
            curves.append(Curve(*curve(result, controller, plant), controller, style))
        y = "" if panels else "RMS contour error [% of the largest radius]"
        log = {"yscale": "log"}
        panels.append(Panel(f"{plant} plant", "traversal time [s]", y, curves, log))
    count, title = len(panels), "Fig. 13: accuracy against traversal time"
    size = (max(5.5, 4.2 * count), 4.6)
    return drawn(panels, size, title, columns=count, legend=4, sharey=True)


FIGURES = {"figure-8": contour, "figures-9-to-11": along_the_path, "figure-13": trade_off}
