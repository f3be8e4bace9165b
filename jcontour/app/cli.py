"""The `jcontour` command.

Everything heavy is imported by the command that needs it, so that --help answers at once.
"""

import _thread
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Union

import tyro

from jcontour.app.flags import loops, machines, others, rules, shared, tuning

COMMANDS: dict[type, tuple[str, str]] = {  # flags -> command, module whose `command(flags)` runs it
    tuning.Tune: ("tune", "jcontour.app.commands.tuning.tune"),
    loops.Simulate: ("simulate", "jcontour.app.commands.loops.simulate"),
    loops.Precompensate: ("precompensate", "jcontour.app.commands.loops.precompensate"),
    tuning.Front: ("front", "jcontour.app.commands.tuning.front"),
    tuning.Rank: ("rank", "jcontour.app.commands.tuning.rank"),
    tuning.Sweep: ("sweep", "jcontour.app.commands.tuning.sweep"),
    loops.Check: ("check", "jcontour.app.commands.loops.check"),
    loops.Export: ("export", "jcontour.app.commands.loops.export"),
    loops.Learn: ("learn", "jcontour.app.commands.loops.learn"),
    machines.Identify: ("identify", "jcontour.app.commands.machines.identify"),
    machines.Audit: ("audit", "jcontour.app.commands.machines.audit"),
    machines.Machine: ("machine", "jcontour.app.commands.machines.machine"),
    others.Bench: ("bench", "jcontour.app.commands.bench"),
    others.Report: ("report", "jcontour.app.commands.report"),
    others.Listing: ("list", "jcontour.app.commands.names"),
    others.Reproduce: ("reproduce", "jcontour.app.commands.reproduce"),
}
BY_FLAG = {  # flag of a command -> module that runs in its place, which loads less
    "list_moves": "jcontour.app.commands.loops.list_moves",
    "excite": "jcontour.app.commands.machines.excite",
    "response": "jcontour.app.commands.machines.identify_response",
}
BAD_INPUT, INTERRUPTED, CUT_OFF = 2, 130, 1
TRACEBACK = "JCONTOUR_TRACEBACK"
MEASURED = "0.10."  # versions of jaxlib whose compiler was measured
COMPILED = 1_000_000_000  # bytes of compiled programs that are kept; the oldest go first


def keep_to_one_thread() -> None:
    """Keep BLAS to one thread, before NumPy is loaded, where the environment does not say another.

    Matrices here are small and commands share their work among threads and processes of their own:
    threads of BLAS beside them wait for each other longer than they compute.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def choose_compiler() -> None:
    """Choose how XLA compiles for a CPU, before JAX makes its first device.

    LAPACK stays out of the pool of threads that XLA runs a program on: on a computer of few cores
    batched factorisations otherwise wait for ever for a thread of the pool that waits for them.

    Where the version is one that this was measured with, the newer fusion emitters are off: without
    them the programs of a tuning run compile in half the time, and run in two thirds of it.
    """
    flags = [os.environ.get("XLA_FLAGS", ""), "--xla_cpu_multi_thread_eigen=false"]
    if flags[1] in flags[0]:  # chosen before
        return
    if version("jaxlib").startswith(MEASURED):  # XLA ends at once at a flag that it does not know
        flags.append("--xla_cpu_use_fusion_emitters=false")
    os.environ["XLA_FLAGS"] = " ".join(flags).strip()


def keep_compiled() -> None:
    """Keep compiled programs in the user's cache folder: the next run need not compile them.

    What the environment or the program says already holds.
    """
    if "jax" in sys.modules or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(Path(caches) / "jcontour" / "compiled")
    os.environ["JAX_COMPILATION_CACHE_MAX_SIZE"] = str(COMPILED)
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.1"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; its exit code."""
    keep_to_one_thread()
    choose_compiler()
    keep_compiled()
    if arguments is None:  # what ends a command from outside ends it as Ctrl-C does
        for one in (signal.SIGINT, signal.SIGTERM):
            signal.signal(one, _interrupt)
        sys.unraisablehook = _unraisable
    with warnings.catch_warnings():
        warnings.showwarning = _print_warning
        # numbers of a loop that diverges: its result says so
        overflow = r"(overflow|invalid value|divide by zero) encountered"
        warnings.filterwarnings("ignore", overflow, RuntimeWarning)
        try:
            code = _answered(list(sys.argv[1:] if arguments is None else arguments))
        except Exception:  # what pandas makes of an interruption while it loads
            if not _interruptions:
                raise
            print("jcontour: interrupted", file=sys.stderr)
            code = INTERRUPTED
    if code == INTERRUPTED and arguments is None:  # a second one does not disturb the end
        for one in (signal.SIGINT, signal.SIGTERM):
            signal.signal(one, signal.SIG_IGN)
    return code


_interruptions: list[int] = []  # signals that came


def _interrupt(number: int, frame: FrameType | None) -> None:
    _interruptions.append(number)
    raise KeyboardInterrupt


def _unraisable(raised: Any) -> None:
    """What a destructor raised: an interruption comes again, objects left half made are no news."""
    if issubclass(raised.exc_type, KeyboardInterrupt):
        threading.Timer(0.01, _thread.interrupt_main).start()
    elif not _interruptions:
        sys.__unraisablehook__(raised)


def _print_warning(message, category, filename, lineno, file=None, line=None) -> None:
    """Print a warning of the program as a message; those of others stay as they are."""
    if category is UserWarning:
        said = " ".join(str(message).split())
        if said.startswith("Error reading persistent compilation cache"):  # cut off by `kill -9`
            said = (
                "a compiled program that was kept cannot be read; it is compiled anew each time "
                f"until {os.environ.get('JAX_COMPILATION_CACHE_DIR')} is deleted"
            )
        print(f"jcontour: WARNING: {said}", file=sys.stderr)
    else:
        print(warnings.formatwarning(message, category, filename, lineno, line), file=sys.stderr)


def _answered(arguments: list[str]) -> int:
    flags = None
    try:
        flags, run = _chosen(arguments)
        if isinstance(flags, shared.Storage) and sys.stderr.isatty() and not flags.json:
            # what follows stands in its place
            print("loading ...", end="\r", file=sys.stderr, flush=True)
        _check_precision()
        # a GPU is for `--devices` of more than one and for `bench`: a few hundred runs take a CPU
        # less time than compiling their programs for a GPU
        if getattr(flags, "devices", "1") == "1" and not isinstance(flags, others.Bench):
            os.environ.setdefault("JAX_PLATFORMS", "cpu")
        import_module("jcontour.app.catalogue.known_names").check_flags(flags)
        import_module("jcontour.app.catalogue.own_classes").trust_named(flags)
        _check_folders(flags)
        if isinstance(flags, shared.Storage):
            import_module("jcontour.app.runs.spread.devices").set_up(flags)
        return run(flags)
    except KeyboardInterrupt as interruption:
        how = str(interruption)
        if not hasattr(flags, "resume"):
            import_module("jcontour.app.files.run_folder").remove_unfinished(flags)
        print(f"jcontour: interrupted{'; ' + how if how else ''}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # who reads has seen enough, as `head`; nothing more can be printed
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CUT_OFF
    except (AssertionError, RuntimeError):  # JAX raises one of them where a platform is missing
        missing = _missing_platform()
        if missing is None or os.environ.get(TRACEBACK):
            raise
        print(f"jcontour: {missing}", file=sys.stderr)
        return BAD_INPUT
    except (
        ValueError,
        OSError,
        # ours are ValueErrors; anything else is a fault of this program and keeps its traceback
    ) as error:
        if os.environ.get(TRACEBACK):  # a ValueError may be a fault too: NumPy and JAX raise them
            raise
        print(f"jcontour: {_as_typed(' '.join(str(error).split()), flags)}", file=sys.stderr)
        return BAD_INPUT


def _as_typed(said: str, flags: Any) -> str:
    """A message that begins with names of flags, as `mass-kg: ...`, with the flags as typed."""
    names, colon, fault = said.partition(": ")
    known = {
        one.name.replace("_", "-")
        for one in (fields(flags) if is_dataclass(flags) else ())
        if tyro.conf.Positional not in getattr(one.type, "__metadata__", ())
    }
    if colon and known.issuperset(names.split(", ")):
        names = ", ".join(f"--{one}" for one in names.split(", "))
    return names + colon + fault


def _check_precision() -> None:
    """Refuse single precision: cycle times and errors would be others."""
    asked = os.environ.get("JAX_ENABLE_X64", "")
    single = asked.lower() in import_module("jcontour")._SINGLE
    if "jax" in sys.modules:
        single |= not sys.modules["jax"].config.jax_enable_x64
    if single:
        raise ValueError(
            f"JAX_ENABLE_X64={asked}: single precision gives other cycle times and errors; leave "
            "it out: the commands compute in double precision"
        )


def _missing_platform() -> str | None:
    """A line about JAX_PLATFORMS, where it names what this computer has not."""
    asked = os.environ.get("JAX_PLATFORMS")
    if not asked:
        return None
    import jax

    try:
        jax.devices()
    except (AssertionError, RuntimeError):
        return f"JAX_PLATFORMS={asked}: JAX finds no such device here; leave it out, or give cpu"
    return None


def _check_folders(flags: Any) -> None:
    """Refuse a run folder that is needed and missing, or taken, before the work begins."""
    if not hasattr(flags, "out"):  # `list` and `bench` load as little as they can
        return
    run_folder = import_module("jcontour.app.files.run_folder")
    if isinstance(flags, (loops.Check, loops.Export, others.Report)):
        named = flags.runs if isinstance(flags, others.Report) else (flags.run,)
        run_folder.check_named(COMMANDS[type(flags)][0], named)
    if flags.out is not None and not isinstance(flags, (machines.Machine, others.Report)):  # files
        run_folder.check_free(flags.out)


def _chosen(arguments: list[str]) -> tuple[Any, Callable[[Any], int]]:
    if arguments[:1] == ["reproduce"] and len(arguments) > 1 and not arguments[1].startswith("-"):
        return import_module("jcontour.app.commands.reproduce").chosen(arguments[1], arguments[2:])
    choices = tuple(
        Annotated[
            kind, tyro.conf.subcommand(name, prefix_name=False, description=rules.described(kind))
        ]
        for kind, (name, _) in COMMANDS.items()
    )
    kinds: Any = Union[choices]  # noqa: UP007  (made from a tuple)
    flags = rules.read(kinds, arguments, "jcontour", _DESCRIPTION)
    _, module = COMMANDS[type(flags)]
    module = next((BY_FLAG[one] for one in BY_FLAG if getattr(flags, one, None)), module)
    return flags, lambda flags: import_module(module).command(flags)  # devices are set up first


_DESCRIPTION = (
    "Simulate and tune multi-axis contouring machines by gradient. "
    "Printed: feeds in mm/min, accelerations in m/s^2, errors in um. "
    "Bad input is answered in one line, exit code 2; "
    f"{TRACEBACK}=1 in the environment shows where it was found instead."
)

if __name__ == "__main__":
    sys.exit(main())
