"""Tests mirror the tree: every module of the three packages has a test file."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
ELSEWHERE = {  # modules and whole rooms that another file of `tests` tests
    # the contracts, and what each of their implementations goes through
    "jcontour/plant.py": "test_contracts.py",
    # the pieces that contours and programs are made of
    "jcontour/sets/peak_program.py": "jcontour/sets/test_least_peaks.py",
    "jcontour/geometry/pieces.py": "jcontour/geometry/test_contour.py",
    "jcontour/geometry/arcs.py": "jcontour/geometry/test_gcode.py",
    "jcontour/geometry/gcode": "jcontour/geometry/test_gcode.py",
    "jcontour/geometry/gcode/language": "jcontour/geometry/test_gcode.py",
    "jcontour/geometry/gcode/moves": "jcontour/geometry/test_gcode.py",
    # what readers of drawings are made of
    "jcontour/geometry/drawings": "jcontour/geometry/drawings/test_dxf.py",
    "jcontour/analysis/loop_slopes.py": "jcontour/analysis/test_peak_search.py",
    # all forms of the gains, and whole runs in a kernel, against the readable one
    "jcontour/riccati/decoupled.py": "jcontour/riccati/test_laws.py",
    "jcontour/riccati/packed_stage.py": "jcontour/riccati/test_laws.py",
    "jcontour/riccati/packing.py": "jcontour/riccati/test_laws.py",
    "jcontour/riccati/sliding_window.py": "jcontour/riccati/test_laws.py",
    "jcontour/riccati/window_sweep.py": "jcontour/riccati/test_laws.py",
    "jcontour/kernels": "jcontour/kernels/test_lq_metrics.py",
    "jcontour/qp/path.py": "jcontour/qp/test_interior_point.py",
    "jcontour/qp/limit_rows.py": "jcontour/qp/test_interior_point.py",
    "jcontour/host/controller.py": "jcontour/host/test_late.py",
    # the parts of a planned motion
    "jcontour/motion/jerk_limited": "jcontour/motion/jerk_limited/test_planning.py",
    "jcontour/geometry/csv_points.py": "jcontour/geometry/test_toolpaths.py",
    "jcontour/geometry/toolpath_text.py": "jcontour/geometry/test_toolpaths.py",
    # a reader of logs, and what may run of a run folder
    "experiments/files/mat_file.py": "experiments/files/test_log_table.py",
    "experiments/files/trusted_code.py": "experiments/catalogue/test_own_classes.py",
    # the names of the catalogue
    "experiments/catalogue/contours.py": "experiments/catalogue/test_choices.py",
    "experiments/catalogue/controllers.py": "test_contracts.py",
    "experiments/catalogue/designs.py": "experiments/catalogue/test_choices.py",
    "experiments/catalogue/entries.py": "experiments/catalogue/test_choices.py",
    "experiments/catalogue/machines.py": "experiments/catalogue/test_choices.py",
    "experiments/catalogue/plants.py": "test_contracts.py",
    # commands, from the command line
    "experiments/commands/names.py": "experiments/test_cli.py",
    "experiments/commands/loops/check.py": "experiments/commands/loops/test_check_bound.py",
    "experiments/runs/checks/certifying.py": "experiments/commands/loops/test_check_bound.py",
    "experiments/runs/checks/weights/certified_bound.py": (
        "experiments/commands/loops/test_check_bound.py"
    ),
    "experiments/commands/reproduce.py": "experiments/test_cli.py",
    "experiments/machines/emps.py": "experiments/catalogue/test_choices.py",
    "jcontour/plants/emps.py": "experiments/benchmarks/records/test_emps_record.py",
    "experiments/flags": "experiments/test_cli.py",
    "experiments/plain_numbers.py": "experiments/test_cli.py",
    "experiments/reports": "experiments/runs/tuning/test_problem.py",
    "experiments/reports/figures/loops/feeds.py": "experiments/commands/loops/test_feed.py",
    "experiments/reports/figures/tuning/learning.py": "experiments/commands/loops/test_learn.py",
    "experiments/reports/figures/machines/machine.py": (
        "experiments/commands/machines/test_machine.py"
    ),
    "experiments/reports/figures/machines/identification.py": (
        "experiments/commands/machines/test_identify.py"
    ),
    "experiments/reports/figures/machines/linear_axes.py": (
        "experiments/commands/machines/test_identify_linear.py"
    ),
    "experiments/reports/identified_tables.py": (
        "experiments/commands/machines/test_identify_linear.py"
    ),
    "experiments/files/results/linear_result.py": (
        "experiments/commands/machines/test_identify_linear.py"
    ),
    "experiments/reports/figures/loops/predictive.py": (
        "experiments/commands/tuning/test_sweep_predictive.py"
    ),
    "tuning/identification/linear/found.py": "tuning/identification/linear/test_machine.py",
    "tuning/identification/linear/gain_uncertainty.py": (
        "tuning/identification/linear/test_dry_friction.py"
    ),
    "experiments/files/checkpoints.py": "experiments/runs/tuning/test_problem.py",
    "experiments/files/checks.py": "experiments/machines/test_from_file.py",
    "experiments/files/schema.py": "experiments/machines/test_from_file.py",
    "experiments/files/machine_file.py": "experiments/machines/test_from_file.py",
    "experiments/files/results/exported_result.py": "experiments/commands/loops/test_export.py",
    "experiments/reports/exported_tables.py": "experiments/commands/loops/test_export.py",
    "experiments/files/results/machine_result.py": "experiments/commands/machines/test_machine.py",
    "experiments/files/results/bent_result.py": "experiments/commands/loops/test_precompensate.py",
    "experiments/runs/loops/bending.py": "experiments/commands/loops/test_precompensate.py",
    "jcontour/wrapper.py": "jcontour/plants/wrappers/test_wrapper.py",
    "experiments/files/results/feed_result.py": "experiments/runs/loops/test_feeds.py",
    "experiments/designs/predictive/bounded.py": "experiments/commands/loops/test_tolerance.py",
    "experiments/runs/loops/kept_runs.py": "experiments/commands/loops/test_tolerance.py",
    "experiments/files/results/tolerance_result.py": "experiments/commands/loops/test_tolerance.py",
    "experiments/reports/tolerance_tables.py": "experiments/commands/loops/test_tolerance.py",
    "experiments/reports/figures/loops/kept.py": "experiments/commands/loops/test_tolerance.py",
    "experiments/files/results/learned_result.py": "experiments/commands/loops/test_learn.py",
    "experiments/files/results/run_metrics.py": "experiments/commands/test_compare.py",
    "experiments/files/results/simulated_result.py": "experiments/commands/loops/test_simulate.py",
    "experiments/files/results/traversed_result.py": ("experiments/test_tour.py"),
    "experiments/files/results/tuned_result.py": "experiments/commands/tuning/test_tune.py",
    "experiments/files/results/swept_result.py": "experiments/commands/tuning/test_sweep.py",
    "experiments/runs/spread/sweep_runs.py": "experiments/commands/tuning/test_sweep.py",
    "experiments/jobs/pace.py": "experiments/jobs/test_job.py",
    "experiments/runs/motion_summary.py": "experiments/jobs/test_motion_laws.py",
    # what the commands drive, through the catalogue
    "experiments/benchmarks/speed/gantry_engines.py": "experiments/benchmarks/speed/test_gantry.py",
    "experiments/benchmarks/speed/lq_results.py": "experiments/benchmarks/speed/test_lq_tables.py",
    "experiments/benchmarks/speed/plain_loops.py": "experiments/benchmarks/speed/test_lq.py",
    "experiments/benchmarks/speed/timings.py": "experiments/benchmarks/speed/test_lq.py",
    "experiments/designs/contouring_schemes.py": "experiments/designs/test_flexible_axis.py",
    "experiments/designs/design.py": "experiments/designs/test_flexible_axis.py",
    "experiments/designs/gains.py": "experiments/designs/test_flexible_axis.py",
    "experiments/jobs": "experiments/designs/test_flexible_axis.py",
    "experiments/machines/families.py": "experiments/machines/test_flexible_axis.py",
    "experiments/examples": "experiments/examples/test_examples.py",
    # a paper is tested as a whole
    "experiments/papers/alter_tsao": "experiments/papers/test_alter_tsao.py",
    "experiments/papers/contouring_schemes": "experiments/papers/test_contouring_schemes.py",
    "experiments/papers/lam": "experiments/papers/test_lam.py",
    "experiments/papers/mcnab_tsao": "experiments/papers/test_mcnab_tsao.py",
    "experiments/papers/synchronisation": "experiments/papers/test_synchronisation.py",
    "experiments/papers/yuan_bounded": "experiments/papers/test_yuan_bounded.py",
    "experiments/papers/yuan_contouring_bounded": (
        "experiments/papers/test_yuan_contouring_bounded.py"
    ),
    "experiments/papers/yuan_gantry": "experiments/papers/test_yuan_gantry.py",
    "experiments/papers/yuan_tracking": "experiments/papers/test_yuan_tracking.py",
    "experiments/papers/zpetc": "experiments/papers/test_zpetc.py",
}
MODULES = [
    path.relative_to(ROOT).as_posix()
    for package in ("jcontour", "tuning", "experiments")
    for path in sorted((ROOT / package).rglob("*.py"))
    if path.name != "__init__.py"
]


def mirrored(module):
    folder, _, name = module.rpartition("/")
    return ROOT / "tests" / folder / f"test_{name}"


def exception(module):
    """The entry of ELSEWHERE that a module falls under, itself or its room; None without one."""
    room = module.rpartition("/")[0]
    return next((place for place in (module, room) if place in ELSEWHERE), None)


def file_of_tests(module):
    """Where the tests of a module are, or have to be."""
    place, own = exception(module), mirrored(module)
    return own if place is None or own.is_file() else ROOT / "tests" / ELSEWHERE[place]


def holds_a_test(path):
    """Whether it is a file that holds a test."""
    return path.is_file() and "def test_" in path.read_text()


def test_every_module_has_a_test_file():
    expected = {module: file_of_tests(module) for module in MODULES}
    assert not {module: path for module, path in expected.items() if not holds_a_test(path)}


def test_exceptions_are_still_needed():
    """Some module falls under each, and has no mirrored file of its own."""
    needed = {exception(module) for module in MODULES if not mirrored(module).is_file()}
    assert not ELSEWHERE.keys() - needed
