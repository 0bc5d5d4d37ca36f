"""Pictures: files, headers, previews and distances."""

from __future__ import annotations

import io
import math
import os
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from PIL import Image as PillowImage

from furcl.errors import ImageError
from furcl.image import compare
from furcl.image.error import estimated_errors
from furcl.image.exr import read_exr, write_exr
from furcl.image.image import Image
from furcl.image.size import STRIP_PIXELS


@pytest.fixture
def picture(rng) -> Image:
    rgb = rng.exponential(size=(12, 20, 3)).astype(np.float32)
    stats = {
        "seed": 4294967295,
        "spp": 16,
        "sampling": "full-cdf",
        "device": "an é device",
        "features": {"lens": True},
        "seconds": {"render": 1.5},
    }
    return Image(rgb, (rgb * 0.01).astype(np.float32), stats)


def files(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_exr_round_trip_is_exact(picture, tmp_path):
    picture.save(tmp_path / "a.exr")
    again = Image.load(tmp_path / "a.exr")
    assert np.array_equal(again.rgb, picture.rgb)
    assert again.variance is not None
    assert np.array_equal(again.variance, picture.variance)
    assert again.stats == picture.stats
    assert files(tmp_path) == ["a.exr"]


def test_exr_header_names_what_made_it(picture, tmp_path):
    import OpenEXR

    picture.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        header = dict(file.header())
    assert header["furcl:spp"] == 16
    assert header["furcl:seed"] == "4294967295"  # beyond the 31 bits of an integer attribute
    assert header["furcl:sampling"] == "full-cdf"
    assert header["furcl:features"] == '{"lens": true}'
    assert header["chromaticities"][:2] == pytest.approx((0.64, 0.33))


@pytest.mark.parametrize("stops", [0.0, -2.5, 30.0])
def test_exposure_is_kept(picture, tmp_path, stops):
    Image(picture.rgb, exposure_stops=stops).save(tmp_path / "a.exr")
    again = Image.load(tmp_path / "a.exr")
    assert again.exposure_stops == stops
    assert again.png_bytes() == Image(picture.rgb, exposure_stops=stops).png_bytes()


def test_files_hold_no_nan(picture, tmp_path):
    """Variance that is not known is 0 in a file, whose layer `samples` says where."""
    assert picture.variance is not None
    samples = np.full(picture.rgb.shape[:2], 3, np.uint32)
    samples[0, 0], samples[0, 1] = 0, 1
    variance = picture.variance.copy()
    variance[0, 0], variance[0, 1] = 0.0, np.nan
    Image(picture.rgb, variance, samples=samples).save(tmp_path / "a.exr")
    channels, _ = read_exr(tmp_path / "a.exr")
    assert all(np.isfinite(values).all() for values in channels.values())
    assert channels["A"].sum() == channels["A"].size - 1
    again = Image.load(tmp_path / "a.exr")
    assert again.variance is not None
    assert np.array_equal(again.variance, variance, equal_nan=True)
    assert again.samples is not None
    assert np.array_equal(again.samples, samples)


def test_one_sample_has_no_variance(picture, tmp_path):
    samples = np.ones(picture.rgb.shape[:2], np.uint32)
    unknown = np.full_like(picture.rgb, np.nan)
    Image(picture.rgb, unknown, samples=samples).save(tmp_path / "a.exr")
    channels, _ = read_exr(tmp_path / "a.exr")
    assert set(channels) == {"R", "G", "B", "samples"}
    assert Image.load(tmp_path / "a.exr").variance is None


PEAK_BYTES = {".exr": 24.0, ".png": 3.0}  # a pixel, beside the picture: channels in one piece each


@pytest.mark.parametrize("suffix", PEAK_BYTES)
def test_writing_takes_little_memory(tmp_path, suffix):
    """Conversions go by strips: at most an eighth more than what the libraries want."""
    height, width = 4096, 2048
    picture = np.zeros((height, width, 3), np.float32)
    image = Image(picture, picture, exposure_stops=1.0)
    peak = _peak_bytes(lambda: image.save(tmp_path / f"a{suffix}"))
    strip = 3 * 8 * 8 * STRIP_PIXELS  # copies of one as float64
    assert peak <= 1.125 * PEAK_BYTES[suffix] * height * width + strip


def test_the_estimated_error_takes_little_memory():
    picture = np.zeros((4096, 2048, 3), np.float32)
    assert _peak_bytes(lambda: estimated_errors(picture, picture)) <= 3 * 8 * 5 * STRIP_PIXELS


def _peak_bytes(call):
    """The most bytes that Python and numpy held at a time within a call."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_foreign_exr_needs_no_variance(tmp_path):
    grey = np.full((3, 4), 0.5, np.float32)
    write_exr(tmp_path / "y.exr", {"Y": grey}, {})
    image = Image.load(tmp_path / "y.exr")
    assert image.variance is None
    assert image.rgb.shape == (3, 4, 3)
    assert (image.rgb == 0.5).all()


@pytest.mark.parametrize("stops", [0.0, 1.0, -2.0])
def test_png_is_srgb_at_the_exposure(stops):
    values = np.array([0.0, 0.001, 0.18, 0.5, 1.0, 40.0], np.float32)
    rgb = np.repeat(values[None, :, None], 3, axis=2)
    found = np.asarray(PillowImage.open(io.BytesIO(Image(rgb, exposure_stops=stops).png_bytes())))
    for linear, byte in zip(values, found[0, :, 0], strict=True):
        x = min(float(linear) * 2.0**stops, 1.0)
        curve = 12.92 * x if x <= 0.0031308 else 1.055 * x ** (1 / 2.4) - 0.055
        assert abs(int(byte) - 255.0 * curve) <= 0.501


def test_repr_is_a_short_line(picture):
    assert repr(picture) == "Image(20 x 12, 16 spp, with variance)"
    assert repr(Image(picture.rgb, None, {"scene": "fox"})) == "Image(20 x 12, 'fox')"


def test_notebook_shows_the_png(picture):
    shown = PillowImage.open(io.BytesIO(picture._repr_png_()))
    assert (shown.format, shown.size) == ("PNG", (20, 12))
    darker = PillowImage.open(io.BytesIO(Image(np.float32(0.1) * picture.rgb).png_bytes()))
    assert (np.asarray(shown, int) > np.asarray(darker, int)).mean() > 0.9


@pytest.mark.parametrize("suffix", [".exr", ".png"])
def test_a_failed_write_leaves_the_old_file_alone(picture, tmp_path, monkeypatch, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("furcl.files.os.replace", fail)
    with pytest.raises(ImageError, match=f"a{suffix}: cannot be written: No space left"):
        picture.save(path)
    assert path.read_bytes() == b"old"
    assert files(tmp_path) == [path.name]


def exr_bytes(tmp_path, channels) -> bytes:
    write_exr(tmp_path / "whole.exr", channels, {})
    return (tmp_path / "whole.exr").read_bytes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "there is no such file; check the path"),
        (b"", "cannot be read: it is empty"),
        (b"\x89PNG....", "does not start as an OpenEXR file does"),
        (b"\x76\x2f\x31\x01", "damaged or unsupported OpenEXR file"),
        ("half", "damaged OpenEXR file: it ends within the 16 rows from row 16; copy or render"),
        ("channels", r"has the channels A, X; R, G and B \(or Y\) are needed"),
    ],
)
def test_bad_exr_files(tmp_path, content, message):
    path = tmp_path / "bad.exr"
    ramp = np.random.default_rng(1).random((64, 64)).astype(np.float32)
    if content == "half":
        whole = exr_bytes(tmp_path, dict.fromkeys("RGB", ramp))
        path.write_bytes(whole[: len(whole) // 2])
    elif content == "channels":
        path.write_bytes(exr_bytes(tmp_path, dict.fromkeys("AX", ramp)))
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(ImageError, match=rf"bad\.exr: {message}"):
        Image.load(path)


def damaged(whole: bytes, how: str) -> bytes:
    """A file of which a part is missing or wrong."""
    at = 8
    while whole[at]:  # the table of chunks begins after the attributes
        at = whole.index(b"\0", whole.index(b"\0", at) + 1) + 1
        at += 4 + int.from_bytes(whole[at : at + 4], "little")
    at += 1
    first = int.from_bytes(whole[at : at + 8], "little")
    return {
        "header": whole[: at // 2],
        "table": whole[: at + 4],
        "unwritten": whole[: at + 8] + bytes(8) + whole[at + 16 :],
        "row": whole[:first] + b"\x07" + whole[first + 1 :],
        "rows": whole[: first + 20],
        "last byte": whole[:-1],
    }[how]


@pytest.mark.parametrize("compression", ["NO", "ZIP", "PIZ", "DWAB"])
@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("header", "damaged or unsupported OpenEXR file"),
        ("table", "it ends before its pixels"),
        ("unwritten", r"row \d+ was never written"),
        ("row", "there is something else where row 0 should be"),
        ("rows", r"it ends within the \d+ rows from row 0|it ends before row 1"),
        ("last byte", r"it ends within the \d+ rows from row \d+"),
    ],
)
def test_cut_off_exr_files_are_told_without_a_word_of_the_library(
    tmp_path, capfd, compression, how, message
):
    import OpenEXR

    path = tmp_path / "a.exr"
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
    ramp = np.random.default_rng(1).random((300, 8)).astype(np.float32)
    with OpenEXR.File(header, dict.fromkeys("RGB", ramp)) as file:
        file.write(str(path))
    assert Image.load(path).rgb.shape == (300, 8, 3)
    path.write_bytes(damaged(path.read_bytes(), how))
    with pytest.raises(ImageError, match=message):
        Image.load(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("how", ["cut off", "pixels"])
def test_what_other_threads_write_is_not_lost(tmp_path, capfd, how):
    """While a damaged file is read; with "pixels" it is the library that finds it damaged."""
    import OpenEXR

    path = tmp_path / "a.exr"
    waves = np.sin(np.arange(64.0 * 64.0).reshape(64, 64)).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION}
    with OpenEXR.File(header, dict.fromkeys("RGB", waves)) as file:
        file.write(str(path))
    whole = path.read_bytes()
    broken = whole[:-300] + b"\xff" * 300
    path.write_bytes(broken if how == "pixels" else whole[:-1])

    lines = [f"line {i}" for i in range(3000)]
    with ThreadPoolExecutor(1) as beside:
        writing = beside.submit(lambda: [os.write(2, f"{line}\n".encode()) for line in lines])
        while not writing.done():
            with pytest.raises(ImageError, match="damaged"):
                Image.load(path)
    written = capfd.readouterr().err.splitlines()
    assert [line for line in written if line.startswith("line ")] == lines


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.jpg", "the suffix '.jpg' names no picture format; use .exr or .png"),
        ("a", "the suffix '' names no picture format"),
        ("nowhere/a.exr", "the folder .*nowhere does not exist; create it first"),
    ],
)
def test_bad_names_to_save(picture, tmp_path, name, message):
    with pytest.raises(ImageError, match=message):
        picture.save(tmp_path / name)


@pytest.mark.parametrize(
    ("rgb", "variance", "message"),
    [
        (np.zeros((3, 4)), None, r"rgb has the shape \(3, 4\)"),
        (np.zeros((0, 4, 3)), None, r"rgb has the shape \(0, 4, 3\)"),
        (np.zeros((2, 4, 3)), np.zeros((4, 2, 3)), r"variance has the shape \(4, 2, 3\)"),
    ],
)
def test_bad_shapes(rgb, variance, message):
    with pytest.raises(ImageError, match=message):
        Image(rgb, variance)


def test_rmse_and_relmse_by_hand():
    reference = np.zeros((1, 2, 3))
    reference[0, 1] = 2.0
    test = reference + 0.1
    assert compare.rmse(test, reference) == pytest.approx(0.1)
    assert compare.relmse(test, reference) == pytest.approx(0.5 * (0.01 / 0.01 + 0.01 / 4.01))


def test_largest_difference_names_the_pixel():
    reference = np.ones((5, 7, 3))
    test = reference.copy()
    test[3, 6, 1] = 0.25
    found = compare.largest_difference(test, reference)
    assert (found.column, found.row, found.channel) == (6, 3, "G")
    assert (found.value, found.test, found.reference) == (0.75, 0.25, 1.0)


@pytest.mark.parametrize("reference", ["black", "constant", "mostly black", "picture"])
def test_flip_grows_with_the_error(picture, reference):
    pytest.importorskip("flip_evaluator")
    rgb = picture.rgb.copy()
    if reference in ("black", "constant"):
        rgb[:] = 0.0 if reference == "black" else 0.7
    elif reference == "mostly black":
        rgb[:, 3:] = 0.0
    errors = [compare.flip(rgb + shift, rgb) for shift in (0.0, 0.02, 0.2)]
    assert errors[0] == pytest.approx(0.0, abs=1e-6)
    assert errors[0] < errors[1] <= errors[2] <= 1.0


def test_flip_of_two_black_pictures_is_zero():
    pytest.importorskip("flip_evaluator")
    assert compare.flip(np.zeros((4, 4, 3)), np.zeros((4, 4, 3))) == 0.0


@pytest.mark.statistical
@pytest.mark.parametrize("bias", [0.0, 0.2], ids=["true", "mutant"])
def test_z_scores_see_a_bias(rng, bias):
    mean, sigma = rng.exponential(size=(64, 64, 3)) + 0.1, 0.1
    a, b = (
        Image(mean + sigma * rng.normal(size=mean.shape), np.full(mean.shape, sigma**2))
        for _ in range(2)
    )
    z = compare.z_scores(Image(a.rgb + bias * sigma, a.variance), b)
    assert z.n == mean.size
    # alpha = 0.01, two-sided: 2.576 standard errors of a mean of n unit normal numbers
    assert (abs(z.mean) * math.sqrt(z.n) < 2.576) == (bias == 0.0)
    assert z.rms == pytest.approx(1.0, abs=0.03)


@pytest.mark.statistical
@pytest.mark.parametrize("bias", [0.0, 0.1], ids=["true", "mutant"])
def test_z_of_the_whole_needs_no_variance(rng, bias):
    """With errors three times below what the pictures say, of 100 pairs; alpha = 0.001 in all."""
    sigma = np.array([0.1, 0.3, 0.2])

    def whole():
        a, b = (
            Image(
                sigma * rng.normal(size=(16, 16, 3)),
                np.full((16, 16, 3), 9.0 * sigma**2),
                stats={"sequence": "sobol"},
            )
            for _ in range(2)
        )
        found = compare.z_scores(Image(a.rgb + bias, a.variance, stats=a.stats), b)
        assert found.at_most
        assert found.rms < 0.8
        return found.whole

    z = np.array([whole() for _ in range(100)])
    # a sum of 100 squares of unit normal numbers
    assert ((z**2).sum() < 149.5) == (bias == 0.0)


def test_z_of_independent_samples_is_no_bound(picture):
    assert not compare.z_scores(picture, picture).at_most
    assert compare.z_scores(picture, picture).whole == 0.0


@pytest.mark.parametrize(
    ("test", "reference", "message"),
    [
        (np.zeros((2, 3, 3)), np.zeros((3, 2, 3)), r"the shapes \(2, 3, 3\) and \(3, 2, 3\)"),
        (
            np.full((2, 3, 3), np.nan),
            np.zeros((2, 3, 3)),
            "the first picture is .* column 0, row 0",
        ),
    ],
)
@pytest.mark.parametrize("distance", [compare.rmse, compare.relmse, compare.largest_difference])
def test_pictures_that_cannot_be_compared(test, reference, message, distance):
    with pytest.raises(ImageError, match=message):
        distance(test, reference)


def test_compare_has_all_distances(picture):
    """None between equal pictures; a tenth added shows in each."""
    pytest.importorskip("flip_evaluator")
    found = compare.compare(picture, picture)
    assert found["rmse"] == found["relmse"] == found["flip"] == found["largest"]["value"] == 0.0
    assert found["z"]["rms"] == 0.0
    found = compare.compare(Image(picture.rgb + np.float32(0.1), picture.variance), picture)
    assert found["rmse"] == pytest.approx(0.1, rel=1e-5)
    assert found["largest"]["value"] == pytest.approx(0.1, rel=1e-5)
    expected = np.mean(0.01 / (picture.rgb.astype(np.float64) ** 2 + 0.01))
    assert found["relmse"] == pytest.approx(expected, rel=1e-5)
    assert found["flip"] > 0.0
    variance = 2.0 * picture.variance.astype(np.float64)
    assert found["z"]["rms"] == pytest.approx(np.sqrt(np.mean(0.01 / variance)), rel=1e-4)
