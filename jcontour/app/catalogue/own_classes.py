"""Controllers and plants from a file of the user's: `mine.py:NAME` on the command line.

    --controller    a `Controller`, or what makes one: a class with `for_model(model)`, a function
                    or a class method that takes the machine's model, a `LinearPlant`, and, where it
                    has an argument `preview`, that of the flags; or a class without arguments
    --plant         a `Plant`, or a class or function without arguments that makes one; a
                    `LinearPlant` becomes the same machine as from a machine file. UNCERTAINTY,
                    LIMITS and CONTROL_UNIT in the file state what a machine file states under
                    these names

NAME may be dotted: `mine.py:PD.for_model`. The file is run as it is; it is one file by itself, as
a resumed run reads its own copy. What it prints goes to stderr.
"""

import ast
import inspect
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from difflib import get_close_matches
from functools import cache, reduce
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from jcontour._regular_files import content_of
from jcontour.app.files import checks

if TYPE_CHECKING:  # a question about a name imports none of these
    from jcontour.app.designs.design import Design
    from jcontour.app.flags.shared import Controlled
    from jcontour.app.machines.machine import Machine

FILE = "FILE.py:NAME"
COPIES = "inputs/*/*.py"  # in a run folder
MOST_BYTES = 16 * 2**20
STATED = ("UNCERTAINTY", "LIMITS", "CONTROL_UNIT")  # names in a file with plants
REMEDIES = {  # error of JAX -> what to write in the place of what caused it
    "TracerBoolConversionError": "if, while, and, or, not, min and max of Python cannot decide on "
    "numbers of the run; jnp.where(condition, a, b) and jnp.maximum can",
    "TracerArrayConversionError": "NumPy cannot compute with numbers of the run; use jnp for np",
    "TracerIntegerConversionError": "a list and range cannot take a number of the run; use an "
    "array of jnp",
    "ConcretizationTypeError": "float, int and bool cannot take a number of the run; leave them "
    "out, or use jnp.asarray",
}


class OwnName(NamedTuple):
    """A name in a Python file."""

    path: Path
    name: str

    def __str__(self) -> str:
        return f"{self.path.name}:{self.name}"


def own_name(words: str) -> OwnName | None:
    """File and name of `FILE.py:NAME`; None for anything else."""
    path, _, name = words.rpartition(":")
    if not path.endswith(".py") or not _dotted(name):
        return None
    return OwnName(Path(path), name)


def check_ending(flag: str, words: str) -> None:
    """Raise ValueError where `words` are those of a name in a file that is no Python file."""
    path, _, name = words.rpartition(":")
    if path.endswith(".py") or not _dotted(name) or not Path(path).is_file():
        return
    raise ValueError(f"{flag}: {path} does not end in .py: a class of yours is given as {FILE}")


def trust_named(flags: Any) -> None:
    """Let the Python files run that a command line names; with --trust-code the copies of its runs.

    Args:
        flags: as typed, not those of a stored run.
    """
    for value in vars(flags).values():
        for word in value if isinstance(value, tuple) else (value,):
            if not isinstance(word, str | Path):
                continue
            own, files = own_name(str(word)), []
            if own is not None:
                files = [own.path]
            elif getattr(flags, "trust_code", False) and Path(word).is_dir():
                files = sorted(Path(word).glob(COPIES))
            for path in files:
                with suppress(OSError):  # reported where it is run
                    trust(content_of(path, MOST_BYTES))


def perhaps(name: str, known: Iterable[str]) -> str:
    """The known name that a misspelt one is likely to stand for, in words; empty without one."""
    return "".join(f"perhaps you meant {one}; " for one in get_close_matches(name, known, 1))


def _dotted(name: str) -> bool:
    return all(part.isidentifier() for part in name.split("."))


def own_controller(own: OwnName, machine: "Machine", flags: "Controlled") -> "Design":
    """Design of a controller from a file; its weights are its own fields that are floats."""
    import equinox as eqx
    import numpy as np

    from jcontour.app.catalogue.own_contracts import ContractError, check_controller
    from jcontour.app.designs.design import Design, OwnDesign, made
    from jcontour.controller import Controller
    from jcontour.geometry.contours import line
    from jcontour.motion.references import along
    from jcontour.simulation.closed_loop import simulate

    named = _named(own)
    if inspect.isclass(named) and issubclass(named, Design):
        return named(str(own), machine, flags)
    preview = flags.horizon(machine.model.dt)
    controller = _made(own, Controller, lambda thing: made(thing, machine.model, preview))
    # a short run is traced, so that a fault in the file is reported with its line
    preview, dt = controller.preview, machine.model.dt
    if not isinstance(preview, int) or preview < 0:
        raise ValueError(
            f"{own}: preview needs a whole number of samples, received {checks.shown(preview)}"
        )
    contour = line(np.zeros(len(machine.axes)), np.full(len(machine.axes), 1e-3))
    arc = np.linspace(0.0, float(contour.length), preview + 4)
    reference = along(contour, arc, dt, preview, at_rest=False)
    try:
        check_controller(machine.nominal(), controller, reference, machine.model.inputs)
        eqx.filter_eval_shape(simulate, machine.nominal(), controller, reference)
    except ContractError as error:
        raise _broken(own, error) from None
    except Exception as error:
        raise _fault(own, error, f"fails on {machine.name}") from None
    return OwnDesign(str(own), f"{own.name} of {own.path.name}", controller, machine, flags)


def own_machine(own: OwnName) -> "Machine":
    """Machine around a plant from a file."""
    from jcontour.app.catalogue.own_contracts import ContractError, check_plant
    from jcontour.app.files.machine_file import StatedFields
    from jcontour.app.files.schema import read
    from jcontour.app.machines.from_file import linear_machine
    from jcontour.app.machines.own_plant import axes_of, machine_of
    from jcontour.linear.plant import LinearPlant
    from jcontour.plant import Plant

    plant = _made(own, Plant, lambda thing: thing())
    name = own.name.replace(".", "-")
    linear = isinstance(plant, LinearPlant)
    make: Callable[[Any, str, Any], Machine] = linear_machine if linear else machine_of
    try:
        if not linear:
            check_plant(plant, axes_of(plant))
        known = vars(_module(own.path, content_of(own.path, MOST_BYTES)))
        stated = {one.lower(): known[one] for one in STATED if one in known}
        return make(plant, name, read(StatedFields, stated))
    except (ContractError, checks.MachineError) as error:
        raise _broken(own, error) from None
    except Exception as error:  # the file's code runs in it: any failure is reported with its line
        raise _fault(own, error, "no machine can be made of this plant") from None


def _made(own: OwnName, kind: type, make: Callable[[Any], Any]) -> Any:
    """The named thing if it is of this kind, or else what is made of it."""
    named = _named(own)
    if isinstance(named, kind):
        return named
    is_class = inspect.isclass(named)
    if not callable(named) or (is_class and not issubclass(named, kind)):
        received = "another class" if is_class else type(named).__name__
        raise ValueError(
            f"{own}: needs a {kind.__name__}, or a class or function that makes one, "
            f"received {received}"
        )
    try:
        made = make(named)
    except Exception as error:
        raise _fault(own, error, "cannot be made") from None
    if not isinstance(made, kind):
        raise ValueError(f"{own}: needs to make a {kind.__name__}, made a {type(made).__name__}")
    return made


def _named(own: OwnName) -> Any:
    source = checks.bytes_of(own.path, MOST_BYTES)
    try:
        module = _module(own.path, source)
    except UntrustedCodeError:
        raise
    except (Exception, SystemExit) as error:
        raise _fault(own, error, "the file cannot be run") from None
    try:
        return reduce(getattr, own.name.split("."), module)
    except AttributeError:
        body = ast.parse(source).body  # public classes and functions, in their order
        names = [one.name for one in body if isinstance(one, ast.ClassDef | ast.FunctionDef)]
        names = [name for name in names if not name.startswith("_")]
        has = f"it has {', '.join(names)}" if names else "it defines no class or function"
        raise ValueError(
            f"{own.path}: there is no {own.name!r} in it; {perhaps(own.name, names)}{has}"
        ) from None


@cache
def _module(path: Path, source: bytes) -> ModuleType:
    """Module of a file, run once for all that is asked of it, if the user has chosen to run it."""
    # A run folder may come from somebody else, with code in it, and its settings may name any file:
    # a file runs if a command of the user has named it, now or before. Hashes of these lie outside
    # every run folder.
    digest = sha256(source).hexdigest()
    if digest not in _chosen and digest not in _recorded():
        raise UntrustedCodeError(
            f"{path}: this Python file would run, and none of your commands has named it: read it, "
            "then add --trust-code"
        )
    module = ModuleType(f"{path.stem}_of_user")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # where dataclasses look their annotations up
    with redirect_stdout(sys.stderr), _folder_first(path.parent.resolve()):  # stdout holds JSON
        exec(compile(source, str(path), "exec"), vars(module))
    return module


@contextmanager
def _folder_first(folder: Path) -> Iterator[None]:
    """Let a file import what lies beside it before anything else of that name, as scripts do.

    Modules that this program has loaded under such a name, as `tuning`, are its own again behind.
    """
    beside = {path.stem: path for path in folder.glob("*.py")}
    beside |= {path.parent.name: path for path in folder.glob("*/__init__.py")}
    ours = {
        name
        for name, path in beside.items()
        if (loaded := getattr(sys.modules.get(name), "__file__", None))
        and Path(loaded).resolve() != path  # an environment may lie in his folder too
    }
    hidden = {name: sys.modules.pop(name) for name in [*sys.modules] if name.split(".")[0] in ours}
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        sys.modules.update(hidden)


def _fault(own: OwnName, error: BaseException, words: str) -> ValueError:
    """What failed in the user's file, in one line with its place."""
    numbers = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == str(own.path)
    ]
    if isinstance(error, SyntaxError) and error.filename == str(own.path):
        numbers.append(error.lineno)
    place = f"{own.path}:{numbers[-1]}" if numbers else str(own.path)
    cause = REMEDIES.get(type(error).__name__)
    if cause is not None:
        return ValueError(f"{place}: {own.name}: {words}: {cause}")
    return ValueError(
        f"{place}: {own.name}: {words} ({type(error).__name__}: {checks.line(error)})"
    )


def _broken(own: OwnName, error: Exception) -> ValueError:
    """A contract that is broken, in one line with its place."""
    return ValueError(f"{own.path}: {own.name}: {error}")


_chosen: set[str] = set()  # by this process: the user's folder may not be writable


class UntrustedCodeError(ValueError):
    """A Python file that the user has not chosen to run; one line."""


def trust(content: bytes) -> None:
    """Let a Python file of this content run, now and later."""
    digest = sha256(content).hexdigest()
    _chosen.add(digest)
    with suppress(OSError):  # then it is asked for again
        if digest not in _recorded():
            _record().parent.mkdir(parents=True, exist_ok=True)
            with _record().open("a") as file:
                file.write(f"{digest}\n")


def _recorded() -> set[str]:
    try:
        return set(_record().read_text().split())
    except OSError:
        return set()


def _record() -> Path:
    states = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(states) / "jcontour" / "trusted-code"
