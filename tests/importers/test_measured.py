"""Measured points and responses: the loaders."""

import numpy as np
import pytest

from bdamper.analyses.loop_fit import read_loop
from bdamper.importers.measured_modes import MeasuredMode, read_mode, read_ring_down
from bdamper.importers.measurements import Measurement, load_measured, read_response, read_responses
from bdamper.util.errors import BdamperError
from tests.each import each


def write(tmp_path, text):
    path = tmp_path / "points.csv"
    path.write_text(text)
    return path


def test_points_are_read(tmp_path):
    rows = "0, 280, 2\n\n100, 300,\n50,290, 1.0\n"
    points = load_measured(
        write(tmp_path, f"# rig\nLoad (N), frequency (Hz),amplitude (mm)\n{rows}")
    )
    assert points.load.tolist() == [0.0, 100.0, 50.0]
    assert np.isnan(points.amplitude[1])
    assert points.frequency.tolist() == [280.0, 300.0, 290.0]


@each(
    ("text", "message"),
    [
        ("", "found an empty file"),
        ("force,amplitude\n1,2\n", "line 1: expected the columns"),
        (
            "load (N),amplitude (mm)\n1,2\n2,x\n",
            "line 3: expected a finite number of at least 0 .* 'amplitude', .* 'x'",
        ),
        (
            "load (N),amplitude (mm)\n-1,2\n",
            "line 2: expected a finite number of at least 0 in column 'load', found '-1'",
        ),
        (
            "load (N),amplitude (mm)\n,2\n",
            "line 2: expected a finite number of at least 0 in column 'load', found ''",
        ),
        (
            "load (N),amplitude (mm)\n1,-2\n",
            "line 2: expected .* in column 'amplitude', found '-2'",
        ),
        (
            "load (N),amplitude (mm)\n1,inf\n",
            "line 2: expected .* in column 'amplitude', found 'inf'",
        ),
        (
            "load (N),amplitude (mm)\n10,0,5\n",
            "line 2: expected 2 values separated by commas, .*, found 3: '10,0,5'",
        ),
        (
            "load (N),amplitude (mm)\n",
            "expected rows of numbers after the header, found none",
        ),
    ],
)
def test_bad_files_are_named(tmp_path, text, message):
    with pytest.raises(BdamperError, match=message):
        load_measured(write(tmp_path, text))


def test_a_byte_order_mark_is_no_part_of_the_header(tmp_path):
    path = tmp_path / "points.csv"
    path.write_bytes("load (N),amplitude (mm)\n0,2\n10,1\n".encode("utf-8-sig"))
    assert load_measured(path).load.tolist() == [0.0, 10.0]


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8"])
def test_encodings_are_found(tmp_path, encoding):
    path = tmp_path / "points.csv"
    path.write_bytes("# Prüfstand\nfrequency (Hz),amplitude (µm)\n1,2\n".encode(encoding))
    assert read_response(path).displacement == pytest.approx([2e-6])


@each(
    ("text", "displacement", "frequency"),
    [
        ("Freq [Hz];Amplitude [mm]\n1,5;2,25\n", 2.25e-3, 1.5),
        ("frequency (kHz)\tdisplacement (mil)\n1,5\t2\n", 5.08e-5, 1500.0),
        ("frequency (rad/s),velocity (mm/s)\n10,2\n", 2e-4, 10.0 / 2.0 / np.pi),
        ("frequency (Hz),acceleration (g)\n10,2\n", 2.0 * 9.80665 / (20.0 * np.pi) ** 2, 10.0),
        ("frequency (Hz),amplitude (dB re 1 um)\n10,40\n", 1e-4, 10.0),
        (
            "frequency (Hz),acceleration (m/s^2),phase (deg)\n10,,3\n20,1,\n10,4,180\n",
            4.0 / (20.0 * np.pi) ** 2,
            10.0,
        ),
    ],
)
def test_laboratory_files_become_displacements(tmp_path, text, displacement, frequency):
    found = read_response(write(tmp_path, text))
    assert np.abs(found.displacement) == pytest.approx(
        [displacement]
    ) and found.frequency == pytest.approx([frequency])


def test_phases_of_motions(tmp_path):
    """An acceleration of phase 180 degrees is a displacement of phase 0, unless the phase is that of the displacement."""
    text = "frequency (Hz),acceleration (m/s^2),phase (deg)\n1,4,180\n"
    assert np.angle(read_response(write(tmp_path, text)).displacement) == pytest.approx([0.0])
    found = read_response(write(tmp_path, text), phase_of="displacement")
    assert np.abs(np.angle(found.displacement)) == pytest.approx([np.pi])


def test_tests_of_one_file_and_forces(tmp_path):
    text = "control,Run,frequency (Hz),Load cell,amplitude (mm),force (lbf)\na,2,1,9,3,1\nb,1,2,9,4,2\na,2,3,9,5,3\n"
    first, second = read_responses(write(tmp_path, text), "run")
    assert first.frequency.tolist() == [2.0] and second.displacement == pytest.approx([3e-3, 5e-3])
    assert second.force == pytest.approx(4.4482216 * np.array([1.0, 3.0]))
    named = read_response(
        write(tmp_path, text.replace("amplitude", "Acc 3")), columns={"amplitude": "Acc 3"}
    )
    assert named.amplitude.tolist() == [3.0, 4.0, 5.0]


def test_tables_are_read_like_files():
    """A mapping stands for a pandas frame."""
    table = {"frequency (Hz)": np.array([1.0, 2.0]), "amplitude (mm)": np.array([3.0, np.nan])}
    assert read_response(table).displacement == pytest.approx([3e-3])


def test_a_response_with_units_and_phase(tmp_path):
    path = write(
        tmp_path,
        "# rig 7\nPoint,Frequency (Hz),Amplitude [µm],Phase (deg)\na,340,20,90\nb,341,30,-180\n",
    )
    found = read_response(path)
    assert found.response == pytest.approx([20j, -30.0]) and found.frequency.tolist() == [
        340.0,
        341.0,
    ]
    assert found.displacement == pytest.approx([20e-6j, -30e-6]) and found.name == path.stem
    plain = read_response(
        write(tmp_path, "real,imag,frequency (Hz)\n3,4,100\n"), unit="mm", name="rig"
    )
    assert np.abs(plain.displacement) == pytest.approx([5e-3]) and plain.name == "rig"


def test_a_response_that_was_written_is_read(tmp_path):
    Measurement("rig", np.array([1.0, 2.0]), np.array([3.0 + 4.0j, 1.0])).to_csv(
        tmp_path / "rig.csv"
    )
    found = read_response(tmp_path / "rig.csv")
    assert found.response == pytest.approx([3.0 + 4.0j, 1.0], rel=1e-15) and found.unit == "m"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "amplitude\n1\n",
            "line 1: expected the columns frequency, real, imag; or .*; or frequency, amplitude, found",
        ),
        (
            "frequency (rpm),amplitude (m)\n1,2\n",
            r"line 1, column 'frequency': .* \['Hz', 'kHz', 'rad/s'\], .* 'rpm'",
        ),
        (
            "frequency (Hz),real (m),imag (mm)\n1,2,3\n",
            "points.csv: expected real and imag in the same unit, found 'm'",
        ),
        (
            "frequency (Hz),amplitude (m)\n1,2\n2,x\n",
            "line 3: expected a finite number in column 'amplitude', found 'x'",
        ),
        (
            "frequency (Hz),amplitude (m)\n1\n",
            "no row after the header is complete: each has an empty cell",
        ),
        ("frequency (Hz),amplitude (m)\n1,2,3\n", "line 2: expected 2 values separated by commas"),
        (
            "frequency (Hz),amplitude (m)\n",
            "expected rows of numbers after the header, found none",
        ),
    ],
)
def test_a_response_that_cannot_be_read(tmp_path, text, message):
    with pytest.raises(BdamperError, match=message):
        read_response(write(tmp_path, text))
    with pytest.raises(BdamperError, match="expected a CSV file, found a folder"):
        read_response(tmp_path)


HEADS = {
    "phase": "Frequency (Hz),Amplitude (mm),Phase",
    "frequency": "frequency,amplitude (mm),phase (deg)",
    "amplitude": "frequency (Hz),amplitude,phase (deg)",
    "load": "load,amplitude (mm),frequency (Hz)",
    "force": "displacement (um),force",
    "displacement": "displacement,force (N)",
}
READERS = {"load": load_measured, "force": read_loop, "displacement": read_loop}


@pytest.mark.parametrize("column", HEADS)
def test_a_column_without_a_unit_is_refused_with_the_way_to_write_it(tmp_path, column):
    """Phases of -10, -26 and -42 degrees and loads in kN look like radians and newtons."""
    columns = HEADS[column].count(",") + 1
    path = write(
        tmp_path,
        f"# rig\n{HEADS[column]}\n" + "".join(f"{','.join(['7'] * columns)}\n" for _ in range(3)),
    )
    with pytest.raises(
        BdamperError,
        match=rf"line 2, column '{column}': .* such as '{column} \(\w+\)'.*, found no unit",
    ):
        READERS.get(column, read_response)(path)


def test_units_of_the_header_are_converted(tmp_path):
    phase = np.array([-10.0, -26.0, -42.0])
    rows = "".join(f"0.33,2,{p}\n" for p in phase)
    found = read_response(write(tmp_path, f"frequency (kHz),amplitude (mm),phase (deg)\n{rows}"))
    assert found.frequency == pytest.approx([330.0] * 3) and np.rad2deg(
        found.phase
    ) == pytest.approx(phase)
    unwrapped = read_response(
        write(tmp_path, f"frequency (kHz),amplitude (mm),phase (rad)\n{rows}")
    )
    assert unwrapped.response == pytest.approx(2.0 * np.exp(1j * phase))
    points = load_measured(write(tmp_path, "load (kN),amplitude (V)\n0,3\n0.5,2\n"))
    assert points.load.tolist() == [0.0, 500.0] and points.amplitude.tolist() == [3.0, 2.0]
    x, force = read_loop(write(tmp_path, "displacement (µm),force (kN)\n1,2\n"))
    assert [*x, *force] == pytest.approx([1e-6, 2e3])
    with pytest.raises(
        BdamperError, match=r"column 'amplitude': .* one of \['um'\], found the unit 'mm'"
    ):
        read_response(write(tmp_path, "frequency (Hz),amplitude (mm)\n1,2\n"), unit="um")


@pytest.mark.parametrize(
    "text", ["frequency (Hz),amplitude (m)\n1,{}\n", "frequency (Hz),{}\n1,2\n"]
)
def test_a_field_of_great_length_is_one_line(tmp_path, text):
    path = write(tmp_path, text.format("1" * 200_000))
    expected = r"line \d: expected values separated by ',' of at most 131072 characters"
    with pytest.raises(BdamperError, match=expected) as caught:
        read_response(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


def test_damping_ratios_need_a_unit():
    """0.5 can be half of critical damping or half a per cent of it."""
    columns = {"amplitude (mm)": [1.0], "frequency (Hz)": [2.0]}
    for unit, ratio in (("%", 0.005), ("-", 0.5), ("1", 0.5)):
        assert read_mode(
            columns | {f"damping ratio ({unit})": [0.5]}
        ).damping_ratio == pytest.approx([ratio])
    expected = r"column 'damping ratio': expected its unit in the header, such as 'damping ratio \(%\)', .*, found no unit"
    with pytest.raises(BdamperError, match=expected):
        read_mode(columns | {"damping ratio": [0.5]})


@pytest.mark.parametrize("values", [(1.0, np.nan), (np.inf, 1.0)])
def test_frequencies_and_responses_are_finite(values):
    with pytest.raises(BdamperError, match="expected finite frequencies and responses"):
        Measurement("rig", np.array(values[:1]), np.array(values[1:], complex))


def test_a_mode_over_its_amplitude_is_read(tmp_path):
    text = "acceleration (m/s^2);Frequency (Hz);damping ratio (%)\n4,0;10;0,5\n8;9;\n"
    mode = read_mode(write(tmp_path, text), preload=3.0)
    assert mode.amplitude == pytest.approx([4.0 / (20.0 * np.pi) ** 2, 8.0 / (18.0 * np.pi) ** 2])
    assert mode.damping_ratio[0] == pytest.approx(5e-3) and np.isnan(mode.damping_ratio[1])
    assert mode.preload == 3.0 and mode.source == "points"
    assert np.isnan(
        read_mode({"amplitude (mm)": [1.0], "frequency (Hz)": [2.0]}, noise=1e-3).damping_ratio
    ).all()
    with pytest.raises(
        BdamperError,
        match="expected a noise of the frequency at each point without a measured damping ratio",
    ):
        read_mode({"amplitude (mm)": [1.0], "frequency (Hz)": [2.0]})
    with pytest.raises(BdamperError, match="mode: expected damping_ratio above 0, found"):
        MeasuredMode(np.ones(1), np.ones(1), -np.ones(1))
    with pytest.raises(BdamperError, match="expected frequency of each point"):
        MeasuredMode(np.ones(2), np.ones(1), np.ones(2))


T = np.arange(0.0, 8.0, 1.0 / 2048.0)
OMEGA = 100.0 * np.pi


@pytest.mark.parametrize(("damping", "error"), [(1e-3, 1e-3), (1e-2, 6e-3), (3e-2, 2.5e-2)])
def test_an_exponential_decay(damping, error):
    """The closed form: frequency without damping and damping ratio are constant."""
    t = T[min(8.0, 5.5 / (damping * OMEGA)) > T]
    x = 2e-3 * np.exp(-damping * OMEGA * t) * np.cos(OMEGA * np.sqrt(1.0 - damping**2) * t + 0.3)
    mode = read_ring_down({"time (s)": t, "displacement (mm)": 1e3 * x})
    assert len(mode.amplitude) > 4 and np.abs(mode.damping_ratio / damping - 1.0).max() < error
    assert mode.frequency == pytest.approx(np.full(len(mode.amplitude), 50.0), rel=0.02 * error)
    middle = np.log(2e-3 / mode.amplitude) / (damping * OMEGA)  # times of the points
    assert (
        np.ptp(np.diff(middle)) < 0.02 * np.diff(middle).mean()
        and 0.0 < middle[0] < middle[-1] < t[-1]
    )


def coulomb(offset):
    """Closed form of the free decay of m x'' + k x + F sign x' = 0 with F/k = offset, half period by half period."""
    half = (OMEGA * T // np.pi).astype(int)
    centre = np.where(half % 2 == 0, offset, -offset)
    return (centre + (1e-3 - offset - 2.0 * offset * half) * np.cos(OMEGA * T))[
        T < 2.3
    ]  # at rest after 2.5 s


def test_a_decay_by_coulomb_friction():
    """The damping ratio is 2 F / (pi k A), at the frequency without friction."""
    x = coulomb(2e-6)
    mode = read_ring_down({"time (s)": T[: len(x)], "displacement (m)": x})
    assert len(mode.amplitude) > 10 and mode.amplitude[0] > 4.0 * mode.amplitude[-1]
    assert mode.damping_ratio == pytest.approx(4e-6 / np.pi / mode.amplitude, rel=1e-2)
    assert mode.frequency == pytest.approx(np.full(len(mode.amplitude), 50.0), rel=2e-4)


@pytest.mark.slow
def test_a_decay_ends_where_noise_begins():
    x = 1e-3 * np.exp(-0.01 * OMEGA * T) * np.cos(OMEGA * T)
    noisy = x + 1e-5 * np.random.default_rng(0).standard_normal(len(x))
    mode = read_ring_down({"time (s)": T, "displacement (m)": noisy}, periods=8.0)
    assert mode.amplitude.min() > 1e-5 and np.abs(mode.damping_ratio / 0.01 - 1.0).max() < 0.1
    with pytest.raises(
        BdamperError,
        match="expected a decay over more than 24 periods, found none in 16384 samples",
    ):
        read_ring_down(
            {"time (s)": T, "displacement (m)": np.exp(0.1 * T) * np.cos(OMEGA * T)}, periods=8.0
        )
    with pytest.raises(BdamperError, match="the time step must be constant"):
        read_ring_down({"time (s)": T**2, "displacement (m)": x})


def decaying(time, amplitude, damping, frequency, phase=0.0):
    omega = 2.0 * np.pi * frequency
    return amplitude * np.exp(-damping * omega * time) * np.cos(omega * time + phase)


def two_modes(time):
    return decaying(time, 2.0, 0.004, 40.0) + decaying(time, 9.0, 0.003, 410.0, 1.0)


@pytest.mark.slow
@each(("band", "damping", "frequency"), [((20, 80), 0.004, 40.0), ((300, 550), 0.003, 410.0)])
@each("waiting", [0, 2000])
def test_a_band_separates_the_modes_of_a_blow(band, damping, frequency, waiting):
    """The closed form is that of one mode: the natural frequency is higher than the damped one.

    A record may begin before the blow.
    """
    t = np.arange(0.0, 4.0, 1.0 / 4096.0)
    blow = np.append(np.zeros(waiting), two_modes(t))[: len(t)]
    mode = read_ring_down({"time (s)": t, "acceleration (m/s^2)": blow}, band=band, periods=8.0)
    above_rounding = mode.amplitude > 1e-8 * mode.amplitude[0]
    assert above_rounding.sum() > 10
    assert np.abs(mode.damping_ratio[above_rounding] / damping - 1.0).max() < 0.01
    natural = frequency / np.sqrt(1.0 - damping**2)
    assert np.abs(mode.frequency[above_rounding] / natural - 1.0).max() < 1e-4
    largest = {40.0: 2.0, 410.0: 9.0}[frequency] / (2.0 * np.pi * frequency) ** 2
    assert 0.3 * largest < mode.amplitude[0] < largest


@pytest.mark.slow
def test_a_record_with_several_modes_proposes_bands():
    t = np.arange(0.0, 4.0, 1.0 / 4096.0)
    record = {"time (s)": t, "acceleration (m/s^2)": two_modes(t)}
    found = (
        r"expected a decay of one mode, found modes at 40\.\d+, 4(10|09\.\d+) Hz; "
        r"read one with band=\(20\.\d+, 60\.\d+\) or band=\(22\d, 59\d\.\d\)"
    )
    with pytest.raises(BdamperError, match=found):
        read_ring_down(record)
    with pytest.raises(BdamperError, match="frequencies in the band from 50 to 200 Hz, found 40"):
        read_ring_down(record, band=(50, 200))
    # a weak second mode distorts the decay after the first one has fallen
    second = decaying(t, 1.0, 0.004, 50.0) + decaying(t, 0.015, 0.0002, 200.0)
    with pytest.warns(match=r"other modes end the decay: modes at 50.*, 200"):
        mode = read_ring_down({"time (s)": t, "acceleration (m/s^2)": second}, periods=5.0)
    assert mode.damping_ratio == pytest.approx(np.full(len(mode.amplitude), 0.004), rel=0.1)


@pytest.mark.slow
@each("band", [None, (25.0, 100.0)])
def test_clipped_peaks_are_named(band):
    t = np.arange(0.0, 4.0, 1.0 / 4096.0)
    x = decaying(t, 1.0, 0.004, 50.0, 0.3)
    record = {"time (s)": t, "acceleration (g)": np.clip(x, -0.5, 0.5)}
    # the amplitude falls to half after ln 2 / (damping ratio times angular frequency) = 0.552 s
    with pytest.warns(match=r"peaks up to 0\.5\d+ s are clipped at 0\.5 g"):
        mode = read_ring_down(record, band=band)
    assert mode.damping_ratio == pytest.approx(np.full(len(mode.amplitude), 0.004), rel=0.01)


@pytest.mark.slow
@each(("digit", "damping", "frequency"), [(2048, 0.004, 1.7), (512, 1e-3, 50.0), (64, 0.004, 50.0)])
def test_digits_are_not_clipping(recwarn, digit, damping, frequency):
    """A coarse converter has equal samples at smooth peaks, and equal peaks."""
    t = np.arange(0.0, 40.0, 1.0 / 1024.0)
    x = np.round(digit * decaying(t, 1.0, damping, frequency, 0.3)) / digit
    read_ring_down({"time (s)": t, "displacement (mm)": x})
    assert not recwarn.list


def test_windows_without_samples_for_a_line_are_refused():
    """One period at 900 Hz has two samples at 2 kHz."""
    t = np.arange(0.0, 1.0, 5e-4)
    decay = np.exp(-9.0 * t) * np.cos(2.0 * np.pi * 900.0 * t)
    with pytest.raises(BdamperError, match="periods: expected windows of at least 4 samples"):
        read_ring_down({"time (s)": t, "displacement (m)": decay}, periods=1.0)


def test_columns_of_unequal_length_are_refused():
    table = {"frequency (Hz)": [1.0, 2.0, 3.0], "amplitude (mm)": [1.0, 2.0]}
    with pytest.raises(
        BdamperError, match=r"table: expected columns of equal length, found \[3, 2\]"
    ):
        read_response(table)
