"""Names on a command line, checked before anything heavy is imported: a slip is answered at once."""

from pathlib import Path
from typing import Any

from experiments.catalogue.contours import CONTOURS
from experiments.catalogue.controllers import CONSTRAINED, CONTROLLERS
from experiments.catalogue.machines import MACHINES
from experiments.files.checks import MachineError


def check_plant(name: str) -> None:
    """Raise ValueError unless a machine has this name, or it is that of a file."""
    if name not in MACHINES and not Path(name).suffix:
        raise ValueError(
            f"plant: there is none named {name!r}; "
            f"give {', '.join(MACHINES)}, or a JSON or npz file"
        )


def check_contour(name: str) -> None:
    """Raise ValueError unless a contour has this name, or it is that of a file."""
    if name not in CONTOURS and not Path(name).suffix:
        raise ValueError(
            f"contour: there is none named {name!r}; "
            f"give one of {', '.join(CONTOURS)}, or a toolpath file"
        )


def check_controller(name: str) -> None:
    """Raise ValueError unless a controller has this name; whether it suits the machine is asked later."""
    aliases = {entry.alias for entry in CONTROLLERS.values()}
    if name not in CONTROLLERS and name not in aliases and name not in CONSTRAINED:
        raise ValueError(
            f"controller: there is none named {name!r}; give one of {', '.join(CONTROLLERS)}"
        )


def check_flags(flags: Any) -> None:
    """Check the plant, the controller, the contour and the parts among the flags of any command.

    Raises:
        ValueError: an unknown name, or a file that is not there.
    """
    plant, controller = getattr(flags, "plant", None), getattr(flags, "controller", None)
    contour, parts = getattr(flags, "contour", None), getattr(flags, "parts", ())
    if plant is not None:
        check_plant(plant)
        _check_file(plant, MACHINES)
    if controller is not None:
        check_controller(controller)
    for name in (*parts, *([contour] if contour else [])):
        check_contour(name)
        _check_file(name, CONTOURS)


def _check_file(name: str, known: dict[str, Any]) -> None:
    if name in known:
        return
    try:
        with Path(name).open("rb"):
            pass
    except OSError as error:
        raise MachineError(f"{name}: cannot be read ({error.strerror or error})") from None
