"""NumPy, MATLAB, HDF5, TDMS and LabVIEW files, written by the libraries that own the formats or read by another."""

import math
import zipfile
from functools import partial

import numpy as np
import pytest
from tests.support.required import needs

from kalscope.errors import BadFile, BadSetting, NoMemory
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

needs("duckdb", "rosbags", "mcap")

from tests.sources.made_containers import write_edf  # noqa: E402

h5py = pytest.importorskip("h5py")
nptdms = pytest.importorskip("nptdms")
lvm_read = pytest.importorskip("lvm_read")

T = np.arange(50) * 0.02
X = np.sin(T)


@pytest.fixture
def mat(tmp_path):
    import scipy.io

    def write(**variables):
        scipy.io.savemat(tmp_path / "log.mat", variables)
        return read_recording(tmp_path / "log.mat")

    return write


@pytest.fixture
def hdf5(tmp_path):
    def write(fill, part=None):
        path = tmp_path / "log.h5"
        with h5py.File(path, "w") as file:
            fill(file)
        return read_recording(path, ReadOptions(part=part))

    return write


@pytest.mark.slow
@pytest.mark.parametrize("rate", [{"dt": 0.02}, {"Sample_Rate": 50, "t": np.arange(50.0)}])
def test_a_single_number_of_matlab_is_the_rate(mat, rate):
    recording = mat(x=X, **rate)
    assert (recording.names[0], recording.sample_period) == ("x", pytest.approx(0.02))


@pytest.mark.slow
def test_fields_of_a_matlab_struct_and_a_matrix_are_channels(mat):
    recording = mat(log={"time": T, "acc": np.column_stack([X, -X, X + 1])})
    assert recording.names == ("acc[0]", "acc[1]", "acc[2]")
    np.testing.assert_array_equal(recording.values[:, 1], -X)
    assert recording.sample_period == pytest.approx(0.02)
    recording = mat(t=T, log={"x": X, "y": 2 * X}, other=np.arange(7.0))
    assert (recording.names, recording.sample_period) == (("x", "y"), pytest.approx(0.02))
    assert mat(log={"fs": 50.0, "imu": {"x": X}}).sample_period == pytest.approx(0.02)


def test_matlab_version_73_is_hdf5(tmp_path):
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["x"], file["t"] = X[None, :], T[None, :]  # MATLAB stores a column as a row
        file["note"] = np.full((1, 50), 104, dtype=np.uint16)
        file["note"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file,")
    recording = read_recording(path)
    assert recording.names == ("x",)
    np.testing.assert_array_equal(recording.values[:, 0], X)


@pytest.mark.parametrize("name", ["fs", "Sample Rate (Hz)", "samplingFreq"])
def test_datasets_of_a_group_with_units_and_the_innermost_rate_around_it(hdf5, name):
    def fill(file, place="/"):
        file["run/imu/ax"] = X
        file["run/imu/ax"].attrs["units"] = "m/s^2"
        file["slow/temp"] = np.arange(5.0)
        file["slow"].attrs[name] = 999.0
        file.attrs[name] = 1.0
        file[place].attrs[name] = 50.0

    for place in ("/", "run", "run/imu"):
        recording = hdf5(partial(fill, place=place))
        assert (recording.names, recording.units) == (("ax",), ("m/s^2",))
        assert recording.sample_period == pytest.approx(0.02)
    assert len(hdf5(fill, "slow")) == 5


def test_a_table_of_fields_reads_as_pandas_writes_it(hdf5):
    def fill(file):
        kind = [("index", "<i8"), ("values_block_0", "<f8", (2,))]
        table = np.zeros(50, dtype=kind)
        table["index"], table["values_block_0"][:, 1] = np.arange(50) * 20_000_000 + 1_700_000_000_000_000_000, X
        file["df/table"] = table
        file["df/table"].attrs["index_kind"] = np.bytes_("datetime64[ns]")

    recording = hdf5(fill)
    assert recording.sample_period == pytest.approx(0.02)
    np.testing.assert_array_equal(recording.channel("values_block_0[1]"), X)


def test_nothing_leads_out_of_an_hdf5_file(hdf5, tmp_path):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["secret"] = np.arange(100.0)
    np.arange(100.0).tofile(tmp_path / "raw.bin")

    def fill(file):
        file["x"] = X
        file["out"] = h5py.ExternalLink("secret.h5", "/secret")
        file["soft"] = h5py.SoftLink("/x")
        file["round/again"] = h5py.SoftLink("/")
        file.create_dataset("raw", (100,), "f8", external=[(str(tmp_path / "raw.bin"), 0, 800)])
        layout = h5py.VirtualLayout((100,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "secret", (100,))
        file.create_virtual_dataset("virtual", layout)

    assert hdf5(fill).names == ("x",)


def test_channels_of_tdms_with_units_and_waveform(tmp_path):
    waveform = {"wf_increment": 0.02, "wf_start_time": np.datetime64("2024-05-01T12:00:00"), "unit_string": "V"}
    channels = ("ai", "ch0", X, waveform), ("ai", "ch1", 2 * X, {}), ("slow", "temp", np.arange(4.0), {})
    with nptdms.TdmsWriter(tmp_path / "log.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject(*channel) for channel in channels])
    recording = read_recording(tmp_path / "log.tdms")
    assert (recording.names, recording.units) == (("ch0", "ch1"), ("V", ""))
    np.testing.assert_array_equal(recording.values[:, 1], 2 * X)
    assert recording.sample_period == pytest.approx(0.02)
    for said in ("2024-05-01T12:00:00", '"slow" (4 × 1)'):
        assert any(said in note for note in recording.report.notes)


TABLE = np.zeros(50, dtype=[("time", "f8"), ("x", "f4"), ("who", "U3")])
TABLE["time"], TABLE["x"] = T, X
STAMPS = np.datetime64("2024-05-01T12:00:00", "us") + (T * 1e6).astype("timedelta64[us]")
ACC = np.asfortranarray(np.column_stack((X, X)))
ARRAYS = {
    "one channel": (lambda path: np.save(path, X), ("value 1",), None),
    "columns": (lambda path: np.save(path, np.column_stack((T, X, X))), ("value 1", "value 2"), 0.02),
    "rows": (lambda path: np.save(path, np.asfortranarray(np.vstack((T, X)))), ("value 1",), 0.02),
    "a table": (lambda path: np.save(path, TABLE), ("x",), 0.02),
    "names": (lambda path: np.savez(path, t=T, x=X, words=np.array(["a"])), ("x",), 0.02),
    "stamps": (lambda path: np.savez_compressed(path, at=STAMPS, x=X, any=np.array([{}])), ("x",), 0.02),
    "a rate": (lambda path: np.savez(path, fs=50.0, acc=ACC), ("acc[0]", "acc[1]"), 0.02),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_of_numpy(tmp_path, name):
    write, names, period = ARRAYS[name]
    with (tmp_path / "log.npy").open("wb") as file:
        write(file)
    recording = read_recording(tmp_path / "log.npy")
    assert (recording.names, recording.sample_period) == (names, period and pytest.approx(period))
    np.testing.assert_array_equal(recording.values[:, 0], X.astype("f4") if name == "a table" else X)


def test_the_signals_of_one_rate_of_an_edf_file(tmp_path):
    recording = read_recording(write_edf(tmp_path / "log.edf"))
    assert (recording.names, recording.units, recording.sample_period) == (("EEG Fp1",), ("uV",), 0.01)
    digital = np.concatenate([63.0 * i + np.arange(50) for i in range(4)])
    np.testing.assert_allclose(recording.values[:, 0], -100 + 200 * (digital + 2048) / 4095)
    assert any("2024-03-01T10:00:00" in note for note in recording.report.notes)
    assert len(read_recording(tmp_path / "log.edf", ReadOptions(part="Temp"))) == 20
    with pytest.raises(BadFile, match="one continuous recording"):
        read_recording(write_edf(tmp_path / "log.edf", "EDF+D"))


@pytest.mark.parametrize("kind", ["<f8", "|O"])
def test_numpy_files_that_lie_or_hold_objects_are_refused(tmp_path, kind):
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': (1000000000000,), }}".ljust(117).encode() + b"\n"
    data = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(80)
    (tmp_path / "log.npy").write_bytes(data)
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("x.npy", data)
    for name in ("log.npy", "log.npz"):
        with pytest.raises((BadFile, NoMemory), match=name):
            read_recording(tmp_path / name)


def file_header(sep="\t", decimal=".", x_columns="One"):
    said = {"Writer_Version": "2", "Separator": "Tab" if sep == "\t" else "Comma", "Decimal_Separator": decimal}
    said |= {"Multi_Headings": "Yes", "X_Columns": x_columns, "Date": "2024/02/29", "Time": "23:59:59,5"}
    body = "".join(f"{key}{sep}{value}\n" for key, value in said.items())
    return f"LabVIEW Measurement{sep}\n{body}***End_of_Header***{sep}\n{sep}\n"


def segment(names, rows, *, sep="\t", decimal=".", x="One", step=0.01, start="10:00:00.25", units=None):
    """One segment; `rows` hold the numbers of the channels, the x axis is made of `step`."""
    spread = 2 if x == "Multi" else 1

    def tagged(tag, values):
        cells = [""] * (spread * len(names) + 1)
        cells[1 : 1 + spread * len(values) : spread] = values
        return sep.join([tag, *cells[1:]]) + "\n"

    def written(value):
        return ("" if math.isnan(value) else f"{value:.6f}").replace(".", decimal)

    n = len(names)
    text = tagged("Channels", [str(n)]) + tagged("Samples", [str(len(rows))] * n)
    text += tagged("Date", ["2024/03/01"] * n) + tagged("Time", [start.replace(".", decimal)] * n)
    text += tagged("Y_Unit_Label", units or [f"unit{i}" for i in range(n)])
    text += tagged("X_Dimension", ["Time"] * n) + tagged("X0", ["0.0E+0".replace(".", decimal)] * n)
    text += tagged("Delta_X", [f"{step:.9E}".replace(".", decimal)] * n) + f"***End_of_Header***{sep}\n"

    def line(stamp, cells):
        return sep.join([stamp, *cells] if x != "Multi" else [part for cell in cells for part in (stamp, cell)])

    text += line("X_Value", names) + f"{sep}Comment\n"
    for i, row in enumerate(rows):
        text += line("" if x == "No" else written(i * step), map(written, row)) + "\n"
    return text + "\n"


ROWS = np.round(np.random.default_rng(1).normal(size=(20, 2)), 6)


@pytest.mark.parametrize("x", ["No", "One", "Multi"])
@pytest.mark.parametrize(("sep", "decimal"), [("\t", "."), ("\t", ","), (",", ".")])
def test_every_form_reads_as_lvm_read_reads_it(read, x, sep, decimal):
    form = {"sep": sep, "decimal": decimal}
    text = file_header(x_columns=x, **form) + segment(["a", "b"], ROWS, x=x, units=["V", "g"], **form)
    recording = read(text)
    oracle = lvm_read.read_str(text.replace("\r\n", "\n"), separator=sep)[0]["data"]
    channels = {"No": slice(0, 2), "One": slice(1, 3), "Multi": slice(1, 4, 2)}[x]
    np.testing.assert_array_equal(recording.values, oracle[:, channels])
    np.testing.assert_array_equal(recording.values, ROWS)
    assert (recording.names, recording.units) == (("a", "b"), ("V", "g"))
    assert recording.sample_period == pytest.approx(0.01, rel=1e-12)
    np.testing.assert_allclose(recording.time, np.arange(20) * 0.01, atol=1e-12)
    report = recording.report
    assert report.lines == report.rows + report.headers + report.comments == text.count("\n")


def test_the_step_of_the_header_outranks_an_x_column_that_is_only_rounded(read):
    step = 1.25e-6  # below the six decimals of the x column
    recording = read(file_header() + segment(["a"], ROWS[:, :1], step=step))
    np.testing.assert_allclose(np.diff(recording.time), step, rtol=1e-9)
    text = file_header() + segment(["a"], ROWS[:4, :1], step=1.0)
    for i, stamp in enumerate(["0.3", "1.9", "7.0"], 1):
        text = text.replace(f"\n{i}.000000\t", f"\n{stamp}\t")
    assert read(text).time.tolist() == [0.0, 0.3, 1.9, 7.0]


def test_segments_of_the_same_channels_follow_their_clocks_and_of_others_are_parts(read):
    text = file_header() + segment(["a"], ROWS[:5, :1]) + segment(["a"], ROWS[5:9, :1], start="10:00:02.25")
    recording = read(text)
    np.testing.assert_array_equal(recording.values[:, 0], ROWS[:9, 0])
    np.testing.assert_allclose(recording.time[4:6], [0.04, 2.0], atol=1e-6)
    assert any("2 segments" in note for note in recording.report.notes)
    text = file_header() + segment(["a", "b"], ROWS) + segment(["other"], ROWS[:3, :1])
    assert read(text).names == ("a", "b")
    assert any('"other" (3 × 1)' in note for note in read(text).report.notes)
    assert len(read(text, part="other")) == 3
    with pytest.raises(BadSetting, match='"a, b"'):
        read(text, part="missing")


def test_missing_cells_special_blocks_comments_and_latin_1(read):
    rows = ROWS[:6].copy()
    rows[2, 1] = np.nan
    special = "***Start_Special***\nCHANNELS\t5\n1\t2\t3\n***End_Special***\n"
    text = file_header() + special + segment(["T (°C)", "b"], rows, units=["°C", ""])
    text = text.replace(f"{rows[1, 1]:.6f}\n", f"{rows[1, 1]:.6f}\tLOST 5\n")
    recording = read(text, encoding="latin-1")
    np.testing.assert_array_equal(recording.values, rows)
    assert (recording.names, recording.units) == (("T", "b"), ("°C", ""))


@pytest.mark.parametrize("x", ["One", "No"])
def test_segments_without_a_clock_of_their_own_follow_each_other(read, x):
    dated = segment(["a"], ROWS[:5, :1], x=x)
    undated = "".join(line for line in dated.splitlines(True) if not line.startswith(("Date", "Time\t")))
    recording = read(file_header(x_columns=x) + 3 * undated)
    np.testing.assert_allclose(recording.time, np.arange(15) * 0.01, atol=1e-9)
    assert any("2024-02-29T23:59:59.5" in note for note in recording.report.notes)
