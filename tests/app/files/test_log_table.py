import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat

from jcontour.app.files.log_table import read_table

ROWS = np.array([[0.0, 1.5, -2.0], [0.001, 2.5, 1e-3]])


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_csv_with_and_without_header(tmp_path, separator):
    path = tmp_path / "log.csv"
    lines = [separator.join(str(x) for x in row) for row in ROWS]
    path.write_text("\n".join(["# a comment", separator.join(["Time", "u x", "y"]), "", *lines]))
    table = read_table(path)
    assert list(table) == ["time", "u x", "y"]
    assert np.array_equal(np.stack(list(table.values()), axis=1), ROWS)
    path.write_text("\n".join(lines))
    assert list(read_table(path)) == ["1", "2", "3"]


@pytest.mark.parametrize("decimal", [".", ","])
def test_spaces_between_numbers_as_in_a_table_for_reading(tmp_path, decimal):
    path = tmp_path / "log.dat"
    path.write_text("  t    u\n 0.001 -1.5\n10.002    2e-3 \n".replace(".", decimal))
    table = read_table(path)
    assert table["t"].tolist() == [0.001, 10.002] and table["u"].tolist() == [-1.5, 2e-3]


def test_a_preamble_of_text_above_the_header_is_left_out(tmp_path):
    path = tmp_path / "log.csv"
    above = "Servo trace export V4.2\nDrive;AX5203 X axis\nSample time;0,25 ms\n\n"
    path.write_text(above + "Time [ms];Command [V]\n0,00;-1,5\n0,25;2e-3\n")
    table = read_table(path)
    assert list(table) == ["time [ms]", "command [v]"]
    assert table["time [ms]"].tolist() == [0.0, 0.25] and table["command [v]"][0] == -1.5
    path.write_text(above + "1,5;2\n0,25;2e-3;4\n")  # the header is wanting: it is said
    with pytest.raises(ValueError, match="line 6 does not hold 2 cells"):
        read_table(path)


def test_an_export_of_a_scope_with_times_for_each_group_of_channels(tmp_path):
    """As TwinCAT writes it, rows of numbers among those of text above the channels."""
    path = tmp_path / "scope.csv"
    above = "Name\tscope\nStart\t1329\tMontag, 2. Mai\n\nName\tx_cmd\tName\tx_pos\n"
    above += "SampleTime[ms]\t1\tSampleTime[ms]\t1\nSymbolName\tX\tSymbolName\tY\n"
    above += "Offset\t0\tOffset\t0\n" * 6
    path.write_text(f"{above}\n0\t0,5\t0\t1\n1\t0,6\t1\t1,5\n")
    table = read_table(path)
    assert list(table) == ["time_ms", "x_cmd", "time_ms_1", "x_pos"]
    assert table["time_ms"].tolist() == [0.0, 1.0] and table["x_pos"].tolist() == [1.0, 1.5]
    path.write_text(f"{above}\n0\t0,5\t0\t1\n1\t0,6\t5\t1,5\n")
    with pytest.raises(ValueError, match="several rates"):
        read_table(path)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_decimal_commas_as_many_drives_write_them(tmp_path, encoding):
    path = tmp_path / "log.csv"
    path.write_text("t;u\n0,001;-1,5\n0,002;2e-3\n", encoding=encoding)
    table = read_table(path)
    assert table["t"].tolist() == [0.001, 0.002] and table["u"].tolist() == [-1.5, 2e-3]


@pytest.mark.parametrize(
    ("text", "names", "last"),
    [
        ("#run 1\n#t\tu\t$y$\n0\t1\t2\t\n1\t3\t4\t\n", ["t", "u", "$y$"], [1, 3, 4]),
        (",u,state\n0,1,idle\n1,,cut\n2,3,cut\n", ["1", "u"], [2, 3]),
        ("Period is 100 ns\n\nx +0,5 y -1,5 \nx +0,5 y 2e-3 \n", ["x", "y"], [0.5, 2e-3]),
        ("stamp;u\n2024-01-01 10:00:59;1\n2024-01-01 10:01:01;2\n", ["stamp", "u"], [2, 2]),
        ("t;wei\xdf\n0;1\n1;2\n", ["t", "wei\xdf"], [1, 2]),
        ('t,u\n"0,5","1"\n"0,75","-2,5"\n', ["t", "u"], [0.75, -2.5]),
        ("stamp,u\n23:59:59.5,1\n23:59:59.75,2\n", ["stamp", "u"], [0.25, 2]),
        (
            "Sampling period is 500000 nSec \n\nx +1 y 0 \nx +2 y 3 \n",
            ["x", "y", "time_s"],
            [2, 3, 5e-4],
        ),
    ],
)
def test_what_drives_write_beside_numbers(tmp_path, text, names, last):
    """Comments as header, separators at line ends, text, empty cells, names in lines, stamps.

    Decimal commas in quotes; the period above what LinuxCNC's halscope writes.
    """
    path = tmp_path / "log.txt"
    path.write_text(text, encoding="cp1252")
    table = read_table(path)
    assert list(table) == names and [one[-1] for one in table.values()] == last
    if "state" in text:
        assert np.isnan(table["u"][1])


TRACE = """<?xml version="1.0"?><traceSession><traceDisplaySetup><signals>
<signal key="a" name="cmdPos X"/><signal key="b" name="measPos X"/></signals></traceDisplaySetup>
<traceData><dataFrame><dataSignal id="f1" key="b"/><dataSignal id="f2" key="a"/>
<rec time="0" f1="1.5" f2="2"/><rec time="0.004" f1="-2.5"/></dataFrame></traceData></traceSession>
"""


def test_a_servo_trace_of_a_sinumerik(tmp_path):
    """Its signals by the names of its display; one that a row lacks is no number there."""
    path = tmp_path / "trace.xml"
    path.write_text(TRACE)
    table = read_table(path)
    assert table["time_s"].tolist() == [0, 0.004] and table["measpos x"].tolist() == [1.5, -2.5]
    assert table["cmdpos x"][0] == 2 and np.isnan(table["cmdpos x"][1])
    for text in (TRACE[:-60], TRACE.replace("cmdPos", "measPos")):  # cut off; two of one name
        path.write_text(text)
        with pytest.raises(ValueError, match="not a readable trace of a SINUMERIK"):
            read_table(path)


def test_structs_in_an_array_as_signals_of_simulink(tmp_path):
    signals = np.array([(ROWS[:, 1],), (ROWS[:, 2],)], dtype=[("values", object)])
    savemat(tmp_path / "log.mat", {"out": {"time": ROWS[:, 0], "signals": signals}})
    table = read_table(tmp_path / "log.mat")
    assert table["out.signals_2.values"].tolist() == [-2.0, 1e-3]


def test_structs_of_a_mat_file_and_its_version_7_3(tmp_path):
    savemat(tmp_path / "log.mat", {"rec": {"pos": ROWS.T, "by": {"t": ROWS[:, 0]}}})
    table = read_table(tmp_path / "log.mat")
    assert table["rec.by.t"].tolist() == [0.0, 0.001] and table["rec.pos_2"][2] == 1e-3
    with h5py.File(tmp_path / "new.mat", "w") as file:
        file["rec/t"] = ROWS[:, :1]
    assert read_table(tmp_path / "new.mat")["rec.t"].tolist() == [0.0, 0.001]


def test_a_damaged_mat_file_on_which_the_reader_of_scipy_ends_its_process(tmp_path):
    path = tmp_path / "log.mat"
    savemat(path, {"record": {"t": ROWS[:, 0]}})
    content = bytearray(path.read_bytes())
    first = content.index(ROWS[:, 0].tobytes())  # the type and the size of these numbers before it
    content[first - 8] = 0
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"log\.mat: not a readable MAT file"):
        read_table(path)


def test_mat_and_netcdf(tmp_path):
    savemat(tmp_path / "log.mat", {"t": ROWS[:, :1], "vir": np.eye(3)[:, :2], "name": "EMPS"})
    table = read_table(tmp_path / "log.mat")
    assert set(table) == {"t", "vir_1", "vir_2"}
    assert table["t"].tolist() == [0.0, 0.001] and table["vir_2"].tolist() == [0, 1, 0]
    xr.Dataset({"Q": (("time", "axis"), ROWS[:, 1:])}, {"time": ROWS[:, 0]}).to_netcdf(
        tmp_path / "log.nc", engine="h5netcdf"
    )
    table = read_table(tmp_path / "log.nc")
    assert table["time"].tolist() == [0.0, 0.001] and table["q_1"].tolist() == [1.5, 2.5]


def test_faults_are_told(tmp_path):
    path = tmp_path / "log.csv"
    for text, words in (
        ("", "is empty"),
        ("a,b\n1,2\n3,4\n5,6\n7,8\n9,10\n1,2,3\n", "line 7 does not hold 2 cells"),
        ("a\nb\n", "holds no rows of numbers"),
        ("a,a\n1,2\n", "two columns have the same name"),
    ):
        path.write_text(text)
        with pytest.raises(ValueError, match=words):
            read_table(path)
    path.write_bytes(b"1\x00,\x002\x00")
    with pytest.raises(ValueError, match="cannot be read as text"):
        read_table(path)
    for name, words in (("log.mat", "not a readable MAT"), ("log.nc", "not a readable netCDF")):
        (tmp_path / name).write_bytes(b"nothing of the kind" * 20)
        with pytest.raises(ValueError, match=words):
            read_table(tmp_path / name)
    with pytest.raises(ValueError, match="cannot be read"):
        read_table(tmp_path / "none.csv")
    savemat(tmp_path / "words.mat", {"name": "EMPS"})
    with pytest.raises(ValueError, match="no column of numbers"):
        read_table(tmp_path / "words.mat")
