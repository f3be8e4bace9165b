"""Result of `jcontour export`: what `result.json` of its run folder holds."""

from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """A compiler's check of the exported C code.

    Attributes:
        compiler: and its flags.
        difference: largest, of the controls to those of `replay.csv` [control unit].
        nanoseconds: of one step.
    """

    compiler: str
    difference: float
    nanoseconds: float


@dataclass(frozen=True, kw_only=True)
class ExportedResult:
    """A controller as code.

    Attributes:
        exported: folder of the run.
        controller: its name.
        machine: its name.
        contour: that the plan is made for.
        samples: of the plan.
        states: numbers that the controller remembers.
        gain_sets: different gains along the path.
        in_tables: the plan is compiled in; else the drive reads it, line by line.
        control_unit: unit of the controls.
        difference: largest of the law's controls to those of `simulate` [control unit].
        rounding: largest difference that the precision makes in `replay.csv` [control unit].
        largest_control: of the run [control unit].
        precision: of the numbers, double or single.
        files: name and meaning of every file.
        compiled: checks by the compilers of this computer.
        warnings: what speaks against loading it.
        start: where the axes have to stand, in words.
        end: what is to be done at the end of the plan.
    """

    exported: str
    controller: str
    machine: str
    contour: str
    samples: int
    states: int
    gain_sets: int
    in_tables: bool
    control_unit: str
    difference: float
    rounding: float
    largest_control: float
    precision: str
    files: dict[str, str]
    compiled: list[Compiled] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    start: str = ""
    end: str = ""
