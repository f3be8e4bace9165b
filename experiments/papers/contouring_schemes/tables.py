"""What `jcontour reproduce contouring-schemes` prints."""

from typing import Any

from rich.console import Console

from experiments.papers.contouring_schemes.claims import mean
from experiments.papers.contouring_schemes.runs import CASCADE, CURRENT, INCREMENT
from experiments.reports.tables import digits, plain_table, say, worded_table

COLUMNS = ("contour_um", "peak_um", "motor_um", "tracking_um", "current_a", "increment_a", "time_s")
HEADINGS = (
    "RMS\ncontour um",
    "peak\num",
    "RMS at the\nmotors um",
    "RMS\ntracking um",
    "RMS\ncurrent A",
    "RMS\nincrement A",
    "time s",
)


def show(summary: dict[str, Any], console: Console) -> None:
    """The rules, the comparison on held-out and training contours, every contour, the statements, and the outcome in words."""
    say(console, *rules(summary))
    for loops in _distinct(summary, "loops"):
        for plant in _distinct(summary, "plant"):
            console.print(
                _scheme_table(
                    summary,
                    f"Held-out contours, {loops}, {plant}",
                    loops=loops,
                    plant=plant,
                    training=False,
                )
            )
        console.print(
            _scheme_table(
                summary,
                f"Training contours, {loops}, nominal",
                loops=loops,
                plant="nominal",
                training=True,
            )
        )
        console.print(_contour_table(summary, loops))
    words = [
        (row["item"], row["claim"], row["finding"], row["verdict"]) for row in summary["claims"]
    ]
    console.print(
        worded_table(
            "Statements, feedback alone", ("where", "the paper", "the simulation", "verdict"), words
        )
    )
    say(console, *outcome(summary))


def rules(summary: dict[str, Any]) -> list[str]:
    """What every scheme was given."""
    limits, count, contours = (
        summary["limits"],
        summary["evaluations"],
        ", ".join(_distinct(summary, "contour", training=True)),
    )
    return [
        f"Tuned on the smooth twin ({', '.join(summary['tuned_on'])}) along {contours}: the mean RMS contour error of the end effector.",
        f"{count} evaluations for the cascade, then {count} from it and {count} from the thesis's gains for every scheme.",
        f"Gains: any above zero, k_ff up to 1.5. Limits: RMS current {limits['rms_control']:.4g} A, RMS increment",
        f"{limits['rms_increment']:.4g} A ({CURRENT:g} x and {INCREMENT:g} x what the thesis's gains with feedforward need).",
        "",
    ]


def outcome(summary: dict[str, Any]) -> list[str]:
    """What the comparison comes to: the ranking on held-out contours, and what no scheme can see."""
    lines = [""]
    for loops in _distinct(summary, "loops"):
        held, seen_before = (
            {
                s: mean(summary, s, "contour_um", loops=loops, plant="nominal", training=training)
                for s in _tuned(summary)
            }
            for training in (False, True)
        )
        order = sorted(held, key=lambda s: held[s])
        best = order[0]
        seen = mean(summary, best, "motor_um", loops=loops, plant="nominal", training=False)
        worst = {s: max(_each_machine(summary, s, loops)) for s in (best, CASCADE)}
        lines += [
            f"Held out (training), {loops}: "
            + ", ".join(f"{s} {held[s]:.1f} ({seen_before[s]:.1f}) um" for s in order),
            f"  {best}: {held[best] / held[CASCADE]:.2f} x the error of the plain cascade tuned as much; on the worst machine "
            f"{worst[best]:.1f} against {worst[CASCADE]:.1f} um; {seen:.1f} um at its motors, where it is measured",
        ]
    late = [f"{row['scheme']}, {row['loops']}" for row in summary["tuning"] if not row["feasible"]]
    lines.append(
        "The descents end with the budget: smaller differences than a tenth may turn round with a larger one."
    )
    return [
        *lines,
        *(f"WARNING: no gains within the limits were found for {name}" for name in late),
    ]


def _each_machine(summary: dict[str, Any], scheme: str, loops: str) -> list[float]:
    return [
        mean(summary, scheme, "contour_um", loops=loops, plant=p, training=False)
        for p in _distinct(summary, "plant")
    ]


def _scheme_table(summary: dict[str, Any], title: str, **where: Any):
    rows = [
        [s, *(digits(mean(summary, s, c, **where)) for c in COLUMNS)]
        for s in _distinct(summary, "scheme")
    ]
    return plain_table(f"{title}, stick and slip", ("scheme", *HEADINGS), rows)


def _contour_table(summary: dict[str, Any], loops: str):
    contours = _distinct(summary, "contour")
    rows = [
        [
            s,
            *(
                digits(mean(summary, s, "contour_um", loops=loops, plant="nominal", contour=c))
                for c in contours
            ),
        ]
        for s in _distinct(summary, "scheme")
    ]
    return plain_table(f"RMS contour error um, {loops}, nominal", ("scheme", *contours), rows)


def _tuned(summary: dict[str, Any]) -> list[str]:
    return list(dict.fromkeys(row["scheme"] for row in summary["tuning"]))


def _distinct(summary: dict[str, Any], key: str, **where: Any) -> list[str]:
    return list(
        dict.fromkeys(
            r[key] for r in summary["rows"] if all(r[k] == value for k, value in where.items())
        )
    )
