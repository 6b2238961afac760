"""NumPy, MATLAB, HDF5 and TDMS files, written by the libraries that own the formats."""

import zipfile

import numpy as np
import pytest
import scipy.io
from tests.support.required import needs

from kalscope.errors import BadFile, NoMemory
from kalscope.sources.containers.table import MAX_NUMBERS
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading.recording_file import read_recording

needs("duckdb", "rosbags", "mcap")

from tests.sources.made_containers import write_edf  # noqa: E402

h5py = pytest.importorskip("h5py")
nptdms = pytest.importorskip("nptdms")

T = np.arange(50) * 0.02
X = np.sin(T)


@pytest.fixture
def mat(tmp_path):
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
@pytest.mark.parametrize(
    "rate", [{"Fs": 50}, {"sample_rate": 50.0}, {"dt": 0.02}, {"fs": 50.0, "t": np.arange(50.0)}]
)
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


@pytest.mark.parametrize("place", ["", "run", "run/imu"])
@pytest.mark.parametrize("name", ["fs", "Sample Rate (Hz)", "samplingFreq"])
def test_datasets_of_a_group_with_units_and_the_innermost_rate_around_it(hdf5, place, name):
    def fill(file):
        file["run/imu/ax"] = X
        file["run/imu/ax"].attrs["units"] = "m/s^2"
        file["slow/temp"] = np.arange(5.0)
        file["slow"].attrs[name] = 999.0
        file.attrs[name] = 1.0
        file[place or "/"].attrs[name] = 50.0

    recording = hdf5(fill)
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


def test_a_gigantic_dataset_of_nothing_is_refused(hdf5):
    with pytest.raises(BadFile, match=str(MAX_NUMBERS)):
        hdf5(lambda file: file.create_dataset("x", (1 << 40,), "f8", chunks=(1024,)))


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
