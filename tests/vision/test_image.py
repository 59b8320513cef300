"""Pictures are decoded, rotated, blended and scaled, or refused.

Files that OpenCV cannot write are made byte by byte.
"""

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.read import find_reader
from camgen.vision.image import Header, Picture, read_header, read_picture
from tests.support.files import source

SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "image"
shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the developer data set is not beside the repository"
)

#: Blue, green and red of the upper left corner in each picture that a test makes.
CORNER = (200, 100, 0)


def drawn() -> np.ndarray:
    """30 x 20 grey pixels, of which the upper left 8 x 5 have the colour `CORNER`."""
    picture = np.full((20, 30, 3), 90, np.uint8)
    picture[:5, :8] = CORNER
    return picture


def encoded(suffix: str, pixels: np.ndarray) -> bytes:
    done, data = cv2.imencode(suffix, pixels)
    assert done
    return data.tobytes()


def loaded(folder: Path, data: bytes, name: str = "p.png") -> Picture:
    (folder / name).write_bytes(data)
    return read_picture(source(folder / name))


def refusal(folder: Path, data: bytes, name: str = "p.png") -> str:
    with pytest.raises(InputError) as caught:
        loaded(folder, data, name)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(name + ": ")
    return str(caught.value)


def exif(
    entries: list[tuple[int, int, int | tuple[int, int]]], order: str = "<", camera: bool = False
) -> bytes:
    """A TIFF structure with one directory.

    entries: tag, type and value. A pair of numbers is a ratio, which is stored after the directory.
    camera: whether the structure has a FocalLength, as photos of a camera have.
    """
    entries = [*entries, *([(0x8769, 4, 0)] if camera else [])]
    after = 8 + 2 + 12 * len(entries) + 4
    rows, tail = b"", b""
    for tag, kind, value in entries:
        if isinstance(value, tuple):
            rows += struct.pack(order + "HHII", tag, kind, 1, after + len(tail))
            tail += struct.pack(order + "II", *value)
        else:
            layout, values = ("HH", (value, 0)) if kind == 3 else ("I", (value,))
            rows += struct.pack(order + "HHI" + layout, tag, kind, 1, *values)
    if camera:
        at = after + len(tail)
        rows = rows[:-4] + struct.pack(order + "I", at)
        tail += struct.pack(order + "H", 1) + struct.pack(order + "HHII", 0x920A, 5, 1, at + 18)
        tail += struct.pack(order + "I", 0) + struct.pack(order + "II", 85, 10)
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8)
    return head + struct.pack(order + "H", len(entries)) + rows + b"\0" * 4 + tail


def jpeg(parts: list[tuple[int, bytes]], pixels: np.ndarray | None = None) -> bytes:
    """A JPEG that begins with these segments (marker, bytes) instead of OpenCV's JFIF segment."""
    data = encoded(".jpg", drawn() if pixels is None else pixels)
    assert data[2:4] == b"\xff\xe0"
    rest = data[4 + struct.unpack(">H", data[4:6])[0] :]
    segments = [struct.pack(">BBH", 255, marker, len(body) + 2) + body for marker, body in parts]
    return b"\xff\xd8" + b"".join(segments) + rest


def jfif(unit: int, x: int, y: int) -> tuple[int, bytes]:
    return 0xE0, b"JFIF\0" + struct.pack(">HBHHBB", 0x0102, unit, x, y, 0, 0)


def app1(data: bytes) -> tuple[int, bytes]:
    return 0xE1, b"Exif\0\0" + data


def png(chunks: list[tuple[bytes, bytes]], pixels: np.ndarray | None = None) -> bytes:
    """A PNG with these chunks (name, bytes) after its IHDR."""
    data = encoded(".png", drawn() if pixels is None else pixels)
    packed = b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in chunks
    )
    return data[:33] + packed + data[33:]


def per_metre(x: int, y: int, unit: int = 1) -> list[tuple[bytes, bytes]]:
    return [(b"pHYs", struct.pack(">IIB", x, y, unit))]


# -- pixels


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp"])
def test_pixels_are_those_that_were_saved(suffix: str, tmp_path: Path) -> None:
    picture = loaded(tmp_path, encoded(suffix, drawn()), "p" + suffix)
    assert np.array_equal(picture.pixels, drawn())
    assert picture.pixels.dtype == np.uint8
    assert not picture.pixels.flags.writeable
    assert (picture.name, picture.turned, picture.notes) == ("p" + suffix, False, ())


def test_a_jpeg_and_a_grey_picture_are_decoded(tmp_path: Path) -> None:
    assert np.abs(loaded(tmp_path, jpeg([])).pixels[16:].astype(int) - 90).max() <= 3
    grey = np.arange(200, dtype=np.uint8).reshape(10, 20)
    assert np.array_equal(loaded(tmp_path, encoded(".png", grey)).pixels, grey)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_sixteen_bits_are_scaled_by_the_bits_in_use(bits: int, tmp_path: Path) -> None:
    maximum = 2**bits - 1
    deep = np.linspace(0, maximum, 600).astype(np.uint16).reshape(20, 30)
    picture = loaded(tmp_path, encoded(".tif", deep), "p.tif")
    assert picture.pixels.dtype == np.uint8
    assert np.abs(picture.pixels - deep * (255 / maximum)).max() <= 0.5
    assert f"{bits} bits are in use" in str(picture.notes[0])


def test_transparent_pixels_become_white(tmp_path: Path) -> None:
    clear = np.dstack([drawn(), np.full((20, 30), 255, np.uint8)])
    clear[10, 3] = (10, 20, 30, 0)
    clear[11, 3] = (0, 100, 200, 128)
    picture = loaded(tmp_path, encoded(".png", clear))
    assert picture.pixels[10, 3].tolist() == [255, 255, 255]
    # A channel is value * alpha + white * (1 - alpha), with alpha = 128 / 255.
    assert picture.pixels[11, 3].tolist() == [127, 177, 227]
    assert np.array_equal(picture.pixels[:10], drawn()[:10])
    assert [str(note) for note in picture.notes] == [
        "assumed: 2 transparent pixels blended onto white"
    ]


def test_an_opaque_picture_with_alpha_gives_no_note(tmp_path: Path) -> None:
    opaque = np.dstack([drawn(), np.full((20, 30), 255, np.uint8)])
    picture = loaded(tmp_path, encoded(".png", opaque))
    assert np.array_equal(picture.pixels, drawn())
    assert picture.notes == ()


#: Row and column, in the upright picture, of the first pixel that is stored, for each orientation
#: (tag 274 of Exif 2.3).
CORNERS = dict(enumerate([(0, 0), (0, -1), (-1, -1), (-1, 0)] * 2, 1))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["jpeg", "png", "tiff"])
def test_a_picture_is_rotated_as_its_orientation_states(
    orientation: int, kind: str, tmp_path: Path
) -> None:
    block = exif([(274, 3, orientation)], ">")
    if kind == "tiff":
        data = tiff([(274, orientation)])
    else:
        data = jpeg([app1(block)]) if kind == "jpeg" else png([(b"eXIf", block)])
    picture = loaded(tmp_path, data)
    (tmp_path / "as-stored").write_bytes(data)
    stored = read_picture(source(tmp_path / "as-stored"), sensor=True)
    assert stored.turned == (kind == "tiff" and orientation != 1)
    assert kind == "tiff" or stored.pixels.shape[:2] == (20, 30)
    assert picture.pixels.shape[:2] == ((20, 30) if orientation < 5 else (30, 20))
    blue = picture.pixels[CORNERS[orientation]]
    assert np.abs(blue.astype(int) - CORNER).max() < 12
    # The corner is 8 x 5 pixels. In the wrong mirror image it would be in its place, but 5 x 8.
    width = np.count_nonzero(picture.pixels[CORNERS[orientation][0], :, 0] > 150)
    assert width == (8 if orientation < 5 else 5)
    assert picture.turned == (orientation != 1)
    assert bool(picture.notes) == picture.turned


def tiff(
    tags: list[tuple[int, int]] | None = None,
    density: tuple[int, int] | None = None,
    pages: int = 1,
) -> bytes:
    """An uncompressed RGB TIFF of the drawn picture.

    tags: further tags with their values.
    density: dots per unit, and the unit as tag 296 counts it: 2 is an inch, 3 a cm.
    pages: 2 for a file whose directory is followed by itself.
    """
    rows = drawn()[..., ::-1].tobytes()
    values = {256: 30, 257: 20, 259: 1, 262: 2, 273: 8, 277: 3, 278: 20, 279: len(rows)}
    values |= dict(tags or [])
    start = 8 + len(rows)
    end = start + 2 + 12 * (len(values) + 1 + (3 if density else 0)) + 4
    tail = struct.pack("<HHH", 8, 8, 8)
    entries = []
    for tag, value in values.items():
        kind = 4 if tag in (273, 279) else 3
        entries.append(struct.pack("<HHII", tag, kind, 1, value))
    entries.append(struct.pack("<HHII", 258, 3, 3, end))
    if density:
        entries += [struct.pack("<HHII", tag, 5, 1, end + 6) for tag in (282, 283)]
        entries.append(struct.pack("<HHII", 296, 3, 1, density[1]))
        tail += struct.pack("<II", density[0], 1)
    entries.sort(key=lambda entry: struct.unpack("<H", entry[:2])[0])
    following = start if pages > 1 else 0
    directory = struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<I", following)
    return b"II*\0" + struct.pack("<I", start) + rows + directory + tail


def test_further_pages_are_skipped_with_a_note(tmp_path: Path) -> None:
    assert loaded(tmp_path, tiff()).notes == ()
    assert [note.kind for note in loaded(tmp_path, tiff(pages=2)).notes] == ["skipped"]


# -- density


@pytest.mark.parametrize(
    ("data", "dpi"),
    [
        (png(per_metre(11811, 11811)), 299.9994),
        (png(per_metre(23622, 23622)), 599.9988),
        (png([(b"eXIf", exif([(282, 5, (300, 1)), (283, 5, (300, 1)), (296, 3, 2)]))]), 300),
        (jpeg([jfif(1, 300, 300)]), 300),
        (jpeg([jfif(2, 118, 118)]), 299.72),
        (jpeg([app1(exif([(282, 5, (6000, 10)), (283, 5, (6000, 10)), (296, 3, 2)], ">"))]), 600),
        (
            jpeg(
                [jfif(1, 72, 72), app1(exif([(282, 5, (200, 1)), (283, 5, (200, 1)), (296, 3, 3)]))]
            ),
            508,
        ),
        (tiff(density=(400, 2)), 400),
        (tiff(density=(100, 3)), 254),
    ],
)
def test_a_density_is_read_in_dots_per_inch(data: bytes, dpi: float, tmp_path: Path) -> None:
    picture = loaded(tmp_path, data)
    assert picture.dpi == pytest.approx(dpi, abs=1e-6)
    assert picture.notes == ()


def test_the_density_of_a_bmp_is_read(tmp_path: Path) -> None:
    data = bytearray(encoded(".bmp", drawn()))
    data[38:46] = struct.pack("<ii", 11811, 11811)
    assert loaded(tmp_path, bytes(data)).dpi == pytest.approx(299.9994)


@pytest.mark.parametrize(
    "data",
    [
        png([]),
        png(per_metre(3000, 3000, unit=0)),
        jpeg([]),
        jpeg([jfif(0, 300, 300)]),
        tiff(density=(400, 1)),
    ],
)
def test_a_file_without_density_has_none(data: bytes, tmp_path: Path) -> None:
    picture = loaded(tmp_path, data)
    assert picture.dpi is None
    assert picture.notes == ()


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (png(per_metre(2835, 2835)), "programs write it"),  # 72 per inch
        (png(per_metre(3780, 3780)), "programs write it"),  # 96 per inch
        (jpeg([jfif(1, 72, 72)]), "programs write it"),
        (jpeg([jfif(2, 72, 72)]), "programs write it"),  # 72 per cm instead of per inch
        (jpeg([jfif(1, 1, 1)]), "no scanner has it"),
        (jpeg([jfif(1, 0, 0)]), "no scanner has it"),
        (png(per_metre(2**31, 2**31)), "no scanner has it"),
        (jpeg([jfif(1, 300, 600)]), "it is 600 DPI in the other direction"),
        (
            jpeg([app1(exif([(282, 5, (300, 0)), (283, 5, (300, 0)), (296, 3, 2)]))]),
            "no scanner has it",
        ),
        (
            jpeg([app1(exif([(282, 5, (300, 1)), (283, 5, (300, 1)), (296, 3, 2)], camera=True))]),
            "a camera does not",
        ),
    ],
)
def test_an_implausible_density_is_named_and_not_used(
    data: bytes, why: str, tmp_path: Path
) -> None:
    picture = loaded(tmp_path, data)
    assert picture.dpi is None
    (note,) = picture.notes
    assert "is not used as a scale" in note.what
    assert why in note.why


def test_the_note_on_a_screen_default_names_the_scale_to_set(tmp_path: Path) -> None:
    (note,) = loaded(tmp_path, jpeg([jfif(1, 72, 72)])).notes
    assert "[image] mm_per_px = 0.35278" in note.why  # 25.4 / 72


# -- refused


@pytest.mark.parametrize("kind", ["png", "jpeg", "tiff", "bmp"])
def test_a_file_that_is_cut_off_is_refused(
    kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(1)
    pixels = cv2.GaussianBlur(rng.integers(0, 255, (120, 160, 3), dtype=np.uint8), (0, 0), 2)
    data = encoded({"png": ".png", "jpeg": ".jpg", "tiff": ".tif", "bmp": ".bmp"}[kind], pixels)
    loaded(tmp_path, data)
    cuts = [1, 4, 10, 30, 60, len(data) // 3, len(data) - 40]
    if kind != "tiff":  # OpenCV ends a TIFF with a directory.
        cuts.append(len(data) - 3)
    for cut in cuts:
        refusal(tmp_path, data[:cut])
    assert capfd.readouterr() == ("", "")  # The libraries print nothing either.


def test_a_jpeg_that_the_decoder_would_fill_with_grey_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    pixels = cv2.GaussianBlur(rng.integers(0, 255, (200, 300), dtype=np.uint8), (0, 0), 1)
    data = encoded(".jpg", pixels)
    half = len(data) // 2
    for broken in (data[:half] + b"\xff\xd9", data[:half] + b"\0" * 60 + data[half + 60 :]):
        assert cv2.imdecode(np.frombuffer(broken, np.uint8), cv2.IMREAD_UNCHANGED) is not None
        assert "is damaged: Corrupt JPEG data" in refusal(tmp_path, broken, "half.jpg")


def test_bytes_before_the_end_mark_of_a_jpeg_are_warned_about(tmp_path: Path) -> None:
    data = jpeg([])
    # libjpeg reads the first of these bytes ahead.
    picture = loaded(tmp_path, data[:-2] + b"\x12" * 7 + data[-2:])
    assert np.array_equal(picture.pixels, loaded(tmp_path, data).pixels)
    assert [note.kind for note in picture.notes] == ["warning"]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is empty"),
        (b"hello world, this is text", "is not a PNG, JPEG, TIFF, BMP or PGM image"),
        (b"GIF89a" + bytes(100), "is not a PNG"),
        (b"\x89PNG\r\n\x1a\n", "is not a PNG"),
    ],
)
def test_a_file_that_is_not_a_picture_is_refused(data: bytes, message: str, tmp_path: Path) -> None:
    assert message in refusal(tmp_path, data)


def test_a_huge_picture_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    data = bytearray(encoded(".png", drawn()))
    data[16:24] = struct.pack(">II", 60_000, 60_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    assert "60000 x 60000 pixels, more than 200,000,000" in refusal(tmp_path, bytes(data))


def test_float_pixels_are_refused(tmp_path: Path) -> None:
    assert "float32" in refusal(tmp_path, encoded(".tif", np.zeros((9, 9), np.float32)), "f.tif")


def test_a_picture_is_read_by_a_process_without_standard_error(tmp_path: Path) -> None:
    (tmp_path / "p.png").write_bytes(encoded(".png", drawn()))
    standard_error = os.dup(2)
    os.close(2)
    try:
        picture = read_picture(source(tmp_path / "p.png"))
    finally:
        os.dup2(standard_error, 2)
        os.close(standard_error)
    assert picture.pixels.shape == (20, 30, 3)


@given(
    st.sampled_from(
        [png(per_metre(9, 9)), jpeg([jfif(1, 9, 9), app1(exif([(274, 3, 3)]))]), tiff()]
    ),
    st.data(),
)
def test_the_header_of_a_damaged_file_is_read_or_none(data: bytes, draw: st.DataObject) -> None:
    damaged = bytearray(data[: draw.draw(st.integers(0, len(data)))])
    for index in draw.draw(st.lists(st.integers(0, max(len(damaged) - 1, 0)), max_size=6)):
        if damaged:
            damaged[index] = draw.draw(st.integers(0, 255))
    assert isinstance(read_header(bytes(damaged)), Header | None)


# -- the developer data set


@shared
@pytest.mark.parametrize(
    "path", sorted(SHARED.glob("*/*")) if SHARED.is_dir() else [], ids=lambda path: path.name
)
def test_every_picture_of_the_data_set_is_read(path: Path) -> None:
    if path.name == "truncated.jpg":
        with pytest.raises(InputError, match=r"^truncated.jpg: is "):
            read_picture(source(path))
        return
    picture = read_picture(source(path))
    assert picture.pixels.ndim == 2 or picture.pixels.shape[2] == 3
    assert picture.dpi is None  # Each file has no density, or the default of a screen.


@shared
def test_a_picture_of_16_bits_in_the_data_set_keeps_its_contrast() -> None:
    picture = read_picture(source(SHARED / "scikit-image" / "chessboard_GRAY_U16.tif"))
    assert (picture.pixels.min(), picture.pixels.max()) == (0, 255)
    assert "8 bits are in use" in str(picture.notes[0])


@pytest.mark.parametrize(
    ("data", "values"),
    [
        (b"P5\n# CREATOR: a camera\n3 2\n255\n" + bytes(range(0, 60, 10)), [0, 10, 20, 30, 40, 50]),
        (b"P2 3 2 255 0 10 20 30 40 50", [0, 10, 20, 30, 40, 50]),
        (b"P5 3 2 15\n" + bytes([0, 1, 2, 3, 14, 15]), [0, 17, 34, 51, 238, 255]),
        (b"P2 3 2 15\n0 1 2 3 14 15\n", [0, 17, 34, 51, 238, 255]),
        (
            b"P5 3 2 65535\n" + struct.pack(">6H", 0, 257, 514, 771, 65278, 65535),
            [0, 1, 2, 3, 254, 255],
        ),
    ],
)
def test_a_grey_map_is_read_from_text_and_from_bytes(
    tmp_path: Path, data: bytes, values: list[int]
) -> None:
    assert read_header(data) is not None
    assert find_reader(Source(Path("photo.bin"), data)).name == "image"
    picture = loaded(tmp_path, data, "p.pgm")
    assert picture.pixels.shape == (2, 3)
    assert picture.pixels.ravel().tolist() == values


@pytest.mark.parametrize(
    "data", [b"P5 3 2 255\n" + bytes(5), b"P2 3 2 255\n1 2 3", b"P5 3", b"P5 0 2 255\n"]
)
def test_a_grey_map_that_is_cut_off_is_refused(tmp_path: Path, data: bytes) -> None:
    assert "cut off" in refusal(tmp_path, data, "p.pgm")


@pytest.mark.parametrize(("focal", "kind"), [(26, "jpeg"), (50, "png"), (0, "jpeg")])
def test_the_focal_length_is_read_in_pixels(focal: int, kind: str, tmp_path: Path) -> None:
    """Tag 41989 of Exif 2.3 gives the focal length for 35 mm film, whose diagonal is 43.267 mm.

    The diagonal of the picture is 36.0555 px.
    """
    entry = struct.pack("<HHHIHHI", 1, 41989, 3, 1, focal, 0, 0)
    block = exif([(0x8769, 4, 26)]) + entry
    data = jpeg([app1(block)]) if kind == "jpeg" else png([(b"eXIf", block)])
    picture = loaded(tmp_path, data)
    expected = pytest.approx(focal * 36.0555 / 43.267, rel=1e-5) if focal else None
    assert picture.focal_px == expected
    assert loaded(tmp_path, png([])).focal_px is None
