"""netCDF files with named dimensions and units; the gain schedule as CSV for a drive.

They are written without xarray, which takes a while to import, and read by it as any other.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5netcdf
import h5py
import numpy as np

from jcontour.app.files.run_folder import write
from jcontour.export.code_text import heading
from jcontour.linear.plant import AffinePlan

if TYPE_CHECKING:
    import xarray as xr

LEVEL = 1  # of compression: the signals shrink little beyond it
Variables = dict[str, tuple[Sequence[str], Any, dict[str, Any]]]  # dimensions, values, attributes


def save_variables(variables: Variables, attributes: Mapping[str, Any], path: Path) -> Path:
    """Write netCDF, compressed; a variable named as its dimension is the coordinate of it."""

    def fill(temporary: Path) -> None:
        with h5netcdf.File(temporary, "w") as file:
            file.attrs.update(attributes)
            for name, (dimensions, given, about) in variables.items():
                values, noted = np.asarray(given), dict(about)
                sizes = dict(zip(dimensions, values.shape, strict=True))
                new = {one: size for one, size in sizes.items() if one not in file.dimensions}
                file.dimensions.update(new)
                kind = values.dtype
                if kind.kind in "UO":  # text
                    values, kind = values.astype(object), h5py.string_dtype()
                elif kind.kind == "b":
                    values, kind, noted["dtype"] = values.astype("i1"), "i1", "bool"
                packed = {"compression": "gzip", "compression_opts": LEVEL, "shuffle": True}
                options: dict[str, Any] = packed if values.ndim > 3 else {}
                column = file.create_variable(name, tuple(dimensions), kind, **options)
                column[...] = values
                column.attrs.update(noted)

    return write(path, fill)


def save_dataset(dataset: "xr.Dataset", path: Path) -> Path:
    """Write a data set; its coordinates that are no dimensions are named in an attribute."""
    variables: Variables = {
        str(name): (list(map(str, one.dims)), one, one.attrs)
        for name, one in dataset.variables.items()
    }
    others = " ".join(str(name) for name in dataset.coords if name not in dataset.dims)
    attributes = dataset.attrs | ({"coordinates": others} if others else {})
    return save_variables(variables, attributes, path)


def load_variables(path: Path) -> dict[str, np.ndarray]:
    """Every variable of a netCDF file."""
    with h5netcdf.File(path, "r", decode_vlen_strings=True) as file:
        return {name: np.asarray(one[...]) for name, one in file.variables.items()}


def save_gains(plan: AffinePlan, steps: int, dt: float, control_unit: str, path: Path) -> Path:
    """Gain schedule u = f - F xf of every sample as CSV, 17 digits: k, t_s, F row by row, f.

    Names end in their units; a gain is one per unit of its state.
    """
    F, f = np.asarray(plan.F)[:steps], np.asarray(plan.f)[:steps]
    inputs, states = (range(1, size + 1) for size in F.shape[1:])
    names = [heading(f"F_u{i}_x{j}", control_unit, per=f"x{j}") for i in inputs for j in states] + [
        heading(f"f_u{i}", control_unit) for i in inputs
    ]
    k = np.arange(len(F))
    rows = np.column_stack([k, k * dt, F.reshape(len(F), -1), f])
    formats = ["%d", "%.10g"] + ["%.17g"] * len(names)
    return write(
        path,
        lambda temporary: np.savetxt(
            temporary,
            rows,
            formats,
            ",",
            header=",".join(["k", "t_s", *names]),
            comments="",
            encoding="utf-8",
        ),
    )
