"""Start of the command line: what it loads, and what it sets before JAX is loaded."""

import os
import subprocess
import sys
from importlib.metadata import version

import numpy as np
import pytest


def test_help_imports_nothing_heavy():
    script = (
        "import sys\nfrom jcontour.app.cli import main\n"
        "try:\n main(['tune', '--help'])\nexcept SystemExit: pass\n"
        "assert not {'jax', 'matplotlib', 'xarray', 'scipy'} & set(sys.modules), sys.modules.keys()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_run_loads_neither_data_frames_nor_signal_processing_nor_the_schema():
    script = (
        "import sys, jcontour.app.commands.loops.simulate\n"
        "no = {'xarray', 'pandas', 'pydantic', 'scipy.signal', 'scipy.stats', 'jcontour.bounds'}\n"
        "assert not no & set(sys.modules), no & set(sys.modules)\n"
        "ours = [name for name in sys.modules if name.startswith(('jcontour', 'tuning'))]\n"
        "assert len(ours) <= 200, len(ours)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_program_that_excites_is_written_without_jax(tmp_path):
    limits = tmp_path / "limits.json"
    limits.write_text('{"travel": 200, "speed": 100, "acceleration": 2000, "dt": 0.01}')
    words = ["identify", "--excite", str(limits), "--json", "--out", str(tmp_path / "run")]
    script = (
        "import sys\nfrom jcontour.app.cli import main\n"
        f"assert main({words}) == 0\n"
        "assert not {'jax', 'matplotlib', 'xarray', 'scipy'} & set(sys.modules), sys.modules.keys()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("rows", "loaded"), [(300, set()), (2000, {"scipy"})])
def test_a_log_is_refused_without_jax(rows, loaded, tmp_path):
    """One that is too short, and noise that no command explains."""
    values = np.random.default_rng(0).standard_normal((rows, 2))
    table = np.column_stack([1e-3 * np.arange(rows), values])
    log = tmp_path / "log.csv"
    np.savetxt(log, table, delimiter=",", header="time_s,x_command,x_position_mm", comments="")
    script = (
        "import sys\nfrom jcontour.app.cli import main\n"
        f"assert main(['identify', {str(log)!r}, '--axes', 'X']) == 2\n"
        f"heavy = {{'jax', 'matplotlib', 'xarray', 'pydantic', 'scipy'}} & set(sys.modules)\n"
        f"assert heavy == {loaded}, heavy"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_moves_of_a_program_are_listed_without_jax(tmp_path):
    (tmp_path / "part.ngc").write_text("G21 F600 G1 X10\nM2\n")
    (tmp_path / "mill.json").write_text('{"axes": ["X", "Y", "Z"]}')
    script = (
        "import sys\nfrom jcontour.app.cli import main\n"
        "code = main(['simulate', 'part.ngc', '--plant', 'mill.json', '--list-moves'])\n"
        "assert not {'jax', 'matplotlib', 'xarray', 'scipy'} & set(sys.modules), sys.modules.keys()"
        "\nsys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[1].split() == [
        "1",
        "line",
        "10.0000",
        "0.0000",
        "0.0000",
        "600",
    ]


def test_the_environment_is_set_before_jax_and_what_is_there_stays(tmp_path):
    """In a process of its own: this one has loaded JAX, and then nothing changes."""
    program = (
        "import os, sys, jcontour.app.cli as cli; assert 'numpy' not in sys.modules;"
        "cli.keep_to_one_thread(); cli.choose_compiler(); cli.keep_compiled();"
        "print(os.environ['XLA_FLAGS']); print(os.environ['JAX_COMPILATION_CACHE_DIR']);"
        "print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    ours = ("JAX_", "XLA_", "OPENBLAS_")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    chosen = "--xla_cpu_multi_thread_eigen=false"
    if version("jaxlib").startswith("0.10."):
        chosen += " --xla_cpu_use_fusion_emitters=false"
    cases = [
        ({}, chosen, str(tmp_path / "jcontour" / "compiled"), "1"),
        (
            {
                "XLA_FLAGS": "--one=1",
                "JAX_COMPILATION_CACHE_DIR": "mine",
                "OPENBLAS_NUM_THREADS": "3",
            },
            f"--one=1 {chosen}",
            "mine",
            "3",
        ),
    ]
    for given, *expected in cases:
        environment = {**kept, "XDG_CACHE_HOME": str(tmp_path), **given}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True
        )
        assert done.stdout.splitlines() == expected, done.stderr


def test_a_compiled_program_that_is_cut_off_is_compiled_anew_and_told(tmp_path):
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(tmp_path / "programs")}
    environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    environment["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
    program = "import jax; from jcontour.app import cli; cli._answered = lambda _: "
    program += "print(jax.jit(lambda x: 2.0 * x)(3.0)); cli.main([])"
    told = f"it is compiled anew each time until {tmp_path / 'programs'} is deleted\n"
    for wanted in ("", told):
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True
        )
        assert done.stdout == "6.0\n" and done.stderr.endswith(wanted)
        assert bool(done.stderr) is bool(wanted) and "Traceback" not in done.stderr
        kept = list((tmp_path / "programs").glob("*-cache"))
        assert kept
        for entry in kept:
            entry.write_bytes(entry.read_bytes()[:20])
