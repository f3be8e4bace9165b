"""Tables that `jcontour reproduce contouring-schemes` prints."""

from rich.console import Console
from rich.table import Table

from experiments.papers.contouring_schemes.result import Result
from experiments.papers.contouring_schemes.runs import CASCADE, CURRENT, INCREMENT
from experiments.papers.verdicts import claims_table
from jcontour.app.reports.tables import digits, plain_table, say

HEADINGS = {
    "contour_um": "RMS\ncontour um",
    "peak_um": "peak\num",
    "motor_um": "RMS at the\nmotors um",
    "tracking_um": "RMS\ntracking um",
    "current_a": "RMS\ncurrent A",
    "increment_a": "RMS\nincrement A",
    "time_s": "time s",
}


def show(result: Result, console: Console) -> None:
    """The rules, held-out and training contours, every contour, the statements, the outcome."""
    say(console, *rules(result))
    for loops in result.loops:
        for plant in result.plants:
            title = f"Held-out contours, {loops}, {plant}"
            console.print(_scheme_table(result, title, loops, plant, training=False))
        title = f"Training contours, {loops}, nominal"
        console.print(_scheme_table(result, title, loops, "nominal", training=True))
        console.print(_contour_table(result, loops))
    console.print(claims_table(result.claims, "Statements, feedback alone"))
    say(console, *outcome(result))


def rules(result: Result) -> list[str]:
    """Conditions that were the same for every scheme."""
    count, limits = result.evaluations, result.limits
    plants, contours = ", ".join(result.tuned_on), ", ".join(result.contours(training=True))
    return [
        f"Tuned on the smooth twin ({plants}) along {contours}: "
        "the mean RMS contour error of the end effector.",
        f"{count} evaluations for the cascade, then {count} from it and {count} from the thesis's "
        "gains for every scheme.",
        "Gains: any above zero, k_ff up to 1.5. "
        f"Limits: RMS current {limits['rms_control']:.4g} A, RMS increment",
        f"{limits['rms_increment']:.4g} A ({CURRENT:g} x and {INCREMENT:g} x what the thesis's "
        "gains with feedforward need).",
        "",
    ]


def outcome(result: Result) -> list[str]:
    """Ranking on held-out contours, and what no scheme can see."""
    lines = [""]
    for loops in result.loops:
        lines += _ranking(result, loops)
    lines.append(
        "The descents end with the budget: smaller differences than a tenth may turn round with a "
        "larger one."
    )
    if result.settings.get("quick"):
        lines.append("A quick run decides no statement: its budget is a fifth of the full one.")
    lost = [f"{row.scheme}, {row.loops}" for row in result.tuning if not row.feasible]
    return lines + [f"WARNING: no gains within the limits were found for {name}" for name in lost]


def _ranking(result: Result, loops: str) -> list[str]:
    """All schemes in order, then the best beside the plain cascade."""
    held, seen = {}, {}
    for name in result.schemes:
        held[name] = result.mean(name, loops, "nominal", training=False)
        seen[name] = result.mean(name, loops, "nominal", training=True)
    order = sorted(held, key=lambda name: held[name])
    best = order[0]
    ranked = ", ".join(f"{name} {held[name]:.1f} ({seen[name]:.1f}) um" for name in order)
    ratio = held[best] / held[CASCADE]
    worst, worst_plain = (_worst(result, name, loops) for name in (best, CASCADE))
    motors = result.mean(best, loops, "nominal", training=False, column="motor_um")
    return [
        f"Held out (training), {loops}: {ranked}",
        f"  {best}: {ratio:.2f} x the error of the plain cascade tuned as much; on the worst "
        f"machine {worst:.1f} against {worst_plain:.1f} um; {motors:.1f} um at its motors, where "
        "it is measured",
    ]


def _worst(result: Result, scheme: str, loops: str) -> float:
    """Held-out error on the worst machine [um]."""
    return max(result.mean(scheme, loops, plant, training=False) for plant in result.plants)


def _all_schemes(result: Result) -> list[str]:
    """Tuned schemes, and the cascade before it is tuned."""
    return list(dict.fromkeys(row.scheme for row in result.rows))


def _scheme_table(result: Result, title: str, loops: str, plant: str, training: bool) -> Table:
    rows = []
    for scheme in _all_schemes(result):
        numbers = [
            result.mean(scheme, loops, plant, training=training, column=column)
            for column in HEADINGS
        ]
        rows.append([scheme, *map(digits, numbers)])
    return plain_table(f"{title}, stick and slip", ("scheme", *HEADINGS.values()), rows)


def _contour_table(result: Result, loops: str) -> Table:
    contours, rows = result.contours(), []
    for scheme in _all_schemes(result):
        numbers = [result.mean(scheme, loops, "nominal", contour=contour) for contour in contours]
        rows.append([scheme, *map(digits, numbers)])
    title = f"RMS contour error um, {loops}, nominal"
    return plain_table(title, ("scheme", *contours), rows)
