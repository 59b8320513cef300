"""Masks are compared with drawn pictures of which shape, tones, light and noise are known."""

import re
from itertools import chain
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from camgen.model.errors import CamgenError, InputError, JobError, NoSafeProgram
from camgen.model.job import ImageTable
from camgen.model.pose import frozen
from camgen.model.text import counted
from camgen.vision.image import read_picture
from camgen.vision.mask.cells import make_cells
from camgen.vision.mask.channel import interpolate_strips, remove_shadows
from camgen.vision.mask.clean import clean_mask
from camgen.vision.mask.level import interpolate_tiles
from camgen.vision.mask.part_mask import Mask
from camgen.vision.mask.part_mask import make_mask as masked
from camgen.vision.to_scale import ScaledView, make_scaled_view
from tests.support.files import source

WIDTH, HEIGHT = 620, 480
#: u, v, radius in px: a disc, and a hole in it.
DISC, HOLE = (300.3, 230.7, 160.0), (340.8, 190.2, 41.5)
SCALE = 0.2
#: Two colours (BGR) with the same grey value: 0.114 b + 0.587 g + 0.299 r = 116.
RED, GREEN = (60.0, 71.5, 224.7), (104.0, 140.0, 73.5)


def covered(circle: tuple[float, float, float]) -> np.ndarray:
    """Fraction of each pixel that the circle covers, from 12 x 12 points in a pixel of its edge."""
    u, v, radius = circle
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    distance = np.hypot(x - u, y - v)
    fraction = (distance < radius).astype(np.float32)
    edge = np.abs(distance - radius) < 1
    offsets = (np.arange(12) + 0.5) / 12 - 0.5
    points_x = (x[edge] - u)[:, None, None] + offsets
    points_y = (y[edge] - v)[:, None, None] + offsets[:, None]
    fraction[edge] = (np.hypot(points_x, points_y) < radius).mean(axis=(1, 2))
    return fraction


SHAPE = covered(DISC) - covered(HOLE)
#: Pixels of the part that are at least 4 px from its edge.
INSIDE = cv2.erode(SHAPE, np.ones((9, 9))) > 0.5


def light(slope: float) -> np.ndarray:
    """Brightness: 1 at the left, 1 - slope at the right, less at the bottom by a tenth of slope."""
    across, down = np.linspace(0, 1, WIDTH), np.linspace(0, 1, HEIGHT)[:, None]
    return 1 - slope * across - 0.1 * slope * down


def scene(
    part: object,
    bench: object,
    slope: float = 0.0,
    noise: float = 2.0,
    blur: float = 0.8,
    shape: np.ndarray = SHAPE,
) -> np.ndarray:
    """A picture of the part on the bench. The tone of either is a number, BGR or a picture."""
    part, bench = np.asarray(part, np.float64), np.asarray(bench, np.float64)
    colours = max(part.ndim, bench.ndim) in (1, 3)
    fraction = shape[..., None] if colours else shape
    shade = light(slope)[..., None] if colours else light(slope)
    picture = cv2.GaussianBlur((bench + (part - bench) * fraction) * shade, (0, 0), blur)
    picture += np.random.default_rng(3).normal(0, noise, picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def seen(pixels: np.ndarray, valid: np.ndarray | None = None) -> ScaledView:
    affine = frozen([[SCALE, 0, SCALE / 2], [0, -SCALE, (len(pixels) - 0.5) * SCALE]])
    return ScaledView(pixels, affine, SCALE, valid)


def part_mask(
    view: ScaledView,
    background: ScaledView | None = None,
    name: str = "picture",
    **settings: object,
) -> Mask:
    return masked(view, msgspec.convert(settings, ImageTable), background, name)


def refuse(
    error: type[CamgenError],
    view: ScaledView,
    background: ScaledView | None = None,
    **settings: object,
) -> str:
    """The message with which a picture is refused by this kind of error."""
    with pytest.raises(error) as refused:
        part_mask(view, background, "part.png", **settings)
    return str(refused.value)


def overlap(mask: Mask, shape: np.ndarray = SHAPE) -> float:
    """Intersection of the mask and the shape over their union, 0 to 1."""
    pixels, wanted = mask.pixels > 0, shape > 0.5
    return np.count_nonzero(pixels & wanted) / np.count_nonzero(pixels | wanted)


def edge_errors(
    mask: Mask, circle: tuple[float, float, float], sectors: int = 1
) -> tuple[np.ndarray, float]:
    """Mean distance (sectors,) px of the edge outside the circle, and its standard deviation, px.

    The edge is where the grey value along each of 360 rays crosses the threshold.
    """
    u, v, radius = circle
    angles = (np.arange(360) + 0.5) * np.pi / 180
    steps = np.arange(-4, 4.01, 0.1)
    x = (u + np.cos(angles)[:, None] * (radius + steps)).astype(np.float32)
    y = (v + np.sin(angles)[:, None] * (radius + steps)).astype(np.float32)
    grey = mask.grey.astype(np.float32) - np.float32(mask.level)
    above = cv2.remap(grey, x, y, cv2.INTER_LINEAR)
    ray, k = np.nonzero(above[:, :-1] * above[:, 1:] <= 0)
    assert len(np.unique(ray)) == 360
    before, after = above[ray, k], above[ray, k + 1]
    crossings = steps[k] + 0.1 * before / (before - after)
    # With noise, a ray crosses the threshold more than once: the mean of the crossings counts.
    errors = np.bincount(ray, crossings) / np.bincount(ray)
    return errors.reshape(sectors, -1).mean(axis=1), float(errors.std())


@pytest.mark.parametrize("method", ["auto", "otsu", "adaptive", "threshold"])
@pytest.mark.parametrize(("part", "bench"), [(60, 200), (200, 60), (20, 240), (90, 130), (0, 255)])
def test_in_even_light_the_threshold_is_halfway_between_part_and_bench(
    method: str, part: float, bench: float
) -> None:
    """An error of a hundredth of the contrast moves the edge by 0.025 px."""
    threshold = (part + bench) / 2 if method == "threshold" else None
    mask = part_mask(seen(scene(part, bench)), mask=method, threshold=threshold)
    assert isinstance(mask.level, float)
    assert mask.level == pytest.approx((part + bench) / 2, abs=0.01 * abs(part - bench) + 0.3)
    assert mask.dark == (part < bench)
    assert mask.method == ("otsu" if method == "auto" else method)
    assert overlap(mask) > 0.998
    assert mask.notes == ()
    for circle in (DISC, HOLE):
        assert np.abs(edge_errors(mask, circle, sectors=8)[0]).max() < 0.03


@pytest.mark.parametrize("method", ["auto", "adaptive"])
@pytest.mark.parametrize(("part", "bench"), [(60, 230), (230, 80), (120, 170)])
def test_the_threshold_follows_light_that_falls_to_half(
    method: str, part: float, bench: float
) -> None:
    mask = part_mask(seen(scene(part, bench, slope=0.5)), mask=method)
    assert mask.method == "adaptive"
    halfway = light(0.5) * (part + bench) / 2
    edge = (SHAPE > 0) & (SHAPE < 1)
    assert np.abs(mask.level - halfway)[edge].max() < 0.02 * 0.5 * abs(part - bench)
    assert overlap(mask) > 0.997
    for circle in (DISC, HOLE):
        assert np.abs(edge_errors(mask, circle, sectors=8)[0]).max() < 0.05
    # A constant threshold would deviate by more than the limit above: this test can fail.
    assert np.ptp(halfway[edge]) > 0.2 * abs(part - bench)


def test_otsu_in_slightly_uneven_light_has_a_local_threshold() -> None:
    mask = part_mask(seen(scene(60, 200, slope=0.12)))
    assert mask.method == "otsu"
    assert not isinstance(mask.level, float)
    assert np.abs(edge_errors(mask, DISC, sectors=8)[0]).max() < 0.03


@pytest.mark.parametrize(("part", "bench"), [(110, 130), (130, 110)])
@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_a_picture_of_low_contrast_is_smoothed(part: float, bench: float, slope: float) -> None:
    mask = part_mask(seen(scene(part, bench, slope, noise=4.0)))
    assert overlap(mask) > 0.99
    assert mask.grey.dtype == np.float32
    match = re.fullmatch(
        r"assumed: picture smoothed by 0\.[89] px "
        r"\(its noise is ([\d.]+), part and bench are (\d+) apart\)",
        str(mask.notes[0]),
    )
    assert match is not None
    assert float(match[1]) == pytest.approx(4.0, abs=0.3)
    assert float(match[2]) == pytest.approx(20, abs=2)
    for circle in (DISC, HOLE):
        means, spread = edge_errors(mask, circle)
        assert abs(means[0]) < 0.06
        assert spread < 0.35


def test_a_vignette_in_uneven_light_does_not_move_the_edge() -> None:
    across, down = np.linspace(-1, 1, WIDTH), np.linspace(-0.8, 0.8, HEIGHT)[:, None]
    fall = (1 - 0.25 * (across**2 + down**2)) / light(0.0)
    mask = part_mask(seen(scene(70 * fall, 220 * fall, slope=0.4)))
    assert overlap(mask) > 0.997
    assert np.abs(edge_errors(mask, DISC, sectors=8)[0]).max() < 0.05


def test_a_shiny_part_of_two_tones_is_whole() -> None:
    """A third of the part is 200 on a bench of 250, the rest is 60. Each has another threshold."""
    tones = np.where(np.arange(WIDTH)[None, :] < 245, 200.0, 60.0) * np.ones((HEIGHT, 1))
    mask = part_mask(seen(scene(tones, 250)))
    assert overlap(mask) > 0.995


def test_a_part_of_the_grey_of_the_bench_is_found_by_its_colour() -> None:
    pixels = scene(RED, GREEN)
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    assert abs(float(grey[SHAPE == 1].mean()) - float(grey[SHAPE == 0].mean())) < 1
    with pytest.raises(InputError):
        part_mask(seen(grey))
    for settings in (
        {},
        {"mask": "color"},
        {"color": list(GREEN[::-1])},
        {"color": list(RED[::-1])},
    ):
        mask = part_mask(seen(pixels), **settings)
        assert mask.method == "color"
        assert overlap(mask) > 0.998
        assert np.abs(edge_errors(mask, DISC, sectors=8)[0]).max() < 0.03
        assert np.abs(edge_errors(mask, HOLE, sectors=4)[0]).max() < 0.03
    assert part_mask(seen(pixels)).why.startswith(
        "part and bench differ in colour more clearly than in grey; "
    )


def test_colour_finds_the_edge_in_light_that_falls_to_half() -> None:
    mask = part_mask(seen(scene(RED, GREEN, slope=0.5)), mask="color")
    assert overlap(mask) > 0.997
    assert np.abs(edge_errors(mask, DISC, sectors=8)[0]).max() < 0.06


def test_a_part_of_two_colours_is_whole_if_one_has_the_grey_of_the_bench() -> None:
    left = (np.arange(WIDTH) < 300)[None, :, None] * np.ones((HEIGHT, 1, 1))
    mask = part_mask(seen(scene(np.where(left, RED, (40.0, 40.0, 40.0)), GREEN)))
    assert mask.method == "color"
    assert mask.why.startswith("colour shows more of the part than grey does; ")
    assert overlap(mask) > 0.99
    assert np.abs(edge_errors(mask, HOLE, sectors=4)[0]).max() < 0.25


def wood(seed: int) -> np.ndarray:
    """A bench with grain and stains as dark as the part."""
    rng = np.random.default_rng(seed)
    grain = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), sigmaX=12, sigmaY=1.5)
    picture = 150 + 12 * grain / grain.std()
    for u, v in ((80, 90), (560, 300), (90, 400)):
        cv2.circle(picture, (u, v), 25, 70.0, -1)
    return cv2.GaussianBlur(picture, (0, 0), 2)


@pytest.mark.parametrize("part", [70.0, 240.0])
def test_a_photo_of_the_empty_bench_in_other_light_shows_the_part(part: float) -> None:
    empty = scene(0, wood(5), shape=np.zeros_like(SHAPE))
    brightness = light(0.35) * 0.95
    bench = wood(5) * brightness + 12
    photo = scene(np.full_like(bench, part) * brightness + 12, bench)
    mask = part_mask(seen(photo), seen(empty))
    assert mask.method == "background"
    assert mask.why == "a photo of the empty bench is given"
    assert mask.dark == (part < 100)
    assert overlap(mask) > 0.99
    assert np.abs(edge_errors(mask, DISC)[0]).max() < 0.1


@pytest.mark.parametrize("tint", [(1.0,), (0.5, 0.8, 1.0)])
def test_a_part_darker_and_lighter_than_its_empty_bench_is_whole(tint: tuple[float, ...]) -> None:
    bench = np.dstack([wood(6) * factor for factor in tint])
    empty = scene(0.0, bench, shape=np.zeros_like(SHAPE)).reshape(HEIGHT, WIDTH, -1)
    tones = np.where((np.arange(WIDTH) < 250)[None, :, None], 20.0, 250.0)
    tones = tones * np.ones((HEIGHT, 1, len(tint)))
    photo = scene(tones, empty.astype(np.float64) * 0.9, noise=1.0).reshape(empty.shape)
    mask = part_mask(seen(photo.squeeze()), seen(empty.squeeze()))
    assert overlap(mask) > 0.98
    assert np.abs(edge_errors(mask, HOLE)[0]).max() < 0.1


def test_the_mask_is_one_side_of_the_threshold() -> None:
    for pixels in (scene(60, 200), scene(200, 70, slope=0.5), scene(RED, GREEN)):
        mask = part_mask(seen(pixels))
        side = mask.grey < mask.level if mask.dark else mask.grey > mask.level
        assert not mask.notes
        assert np.array_equal(mask.pixels == 255, side)
        assert set(np.unique(mask.pixels)) == {0, 255}


def test_a_picture_always_gives_the_same_mask_which_cannot_be_written() -> None:
    pixels = scene(60, 200, slope=0.5)
    before = pixels.copy()
    first, second = part_mask(seen(pixels)), part_mask(seen(pixels))
    assert np.array_equal(first.pixels, second.pixels)
    assert np.array_equal(first.level, second.level)
    assert np.array_equal(pixels, before)
    for array in (first.pixels, first.level):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1


def test_a_rotated_picture_has_the_rotated_mask() -> None:
    pixels = scene(60, 200, slope=0.5)
    upright = part_mask(seen(pixels)).pixels
    for quarters in (1, 2, 3):
        rotated = part_mask(seen(np.ascontiguousarray(np.rot90(pixels, quarters)))).pixels
        differences = np.count_nonzero(np.rot90(rotated, -quarters) != upright)
        assert differences < 0.0005 * np.count_nonzero(upright)


def test_specks_and_small_holes_are_removed_and_noted() -> None:
    pixels = scene(60, 200, noise=0.0, blur=0.3)
    for k in range(5):
        pixels[20:24, 40 + 60 * k : 45 + 60 * k] = 60  # 20 px of 0.04 mm2 each
    for k in range(3):
        pixels[300:304, 230 + 40 * k : 234 + 40 * k] = 200
    mask = part_mask(seen(pixels))
    assert [str(note) for note in mask.notes] == [
        "assumed: 5 specks below 1 mm2 left out, 4 mm2 in all "
        "(set [image] min_area lower if they are more than dirt, glare or noise)",
        "assumed: 3 holes below 1 mm2 filled, 1.92 mm2 in all "
        "(set [image] min_area lower if they are more than dirt, glare or noise)",
    ]
    assert overlap(mask) > 0.9999
    kept = part_mask(seen(pixels), min_area=0.6, accept=["specks"])
    assert kept.notes == ()
    assert cv2.connectedComponents(kept.pixels)[0] - 1 == 6
    assert cv2.connectedComponents(cv2.bitwise_not(kept.pixels), connectivity=4)[0] - 1 == 1 + 1 + 3


@pytest.mark.parametrize("seed", range(8))
def test_cleaning_removes_the_specks_and_holes_that_labels_find(seed: int) -> None:
    """Cleaning takes areas from contours by Pick's theorem. Here the labelled pixels are counted.

    The blobs are noise, smoothed more with each seed.
    """
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.normal(0, 1, (240, 300)), (0, 0), 0.7 + 0.5 * seed)
    mask = np.where(noise > noise.std() * (0.1 * seed - 0.3), 255, 0).astype(np.uint8)
    mask[:2], mask[-2:], mask[:, :2], mask[:, -2:] = 0, 0, 0, 0
    min_px = 40
    wanted = mask.copy()
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    specks = [k for k in range(1, count) if stats[k, 4] < min_px]
    wanted[np.isin(labels, specks)] = 0
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        cv2.bitwise_not(wanted), connectivity=4
    )
    holes = [k for k in range(1, count) if stats[k, 4] < min_px]
    wanted[np.isin(labels, holes)] = 255
    min_mm2 = min_px * SCALE**2 * 0.999
    notes = clean_mask(mask, seen(mask.copy()), min_mm2, "noise.png", accepts_specks=True)
    text = " ".join(map(str, notes))
    assert np.array_equal(mask, wanted)
    assert specks or holes
    assert not specks or f"{len(specks)} speck" in text
    assert not holes or counted(len(holes), "hole") in text


def chips(pixels: np.ndarray, count: int) -> np.ndarray:
    """The picture with dark chips of 5 by 12 px in rows along its upper side."""
    littered = pixels.copy()
    for k in range(count):
        row, column = divmod(k, 30)
        littered[8 + 16 * row : 13 + 16 * row, 10 + 20 * column : 22 + 20 * column] = 60
    return littered


def test_chips_beside_the_part_are_left_out_with_a_note() -> None:
    pixels = scene(60, 200, noise=0.0, blur=0.3)
    mask = part_mask(seen(chips(pixels, 30)))
    assert np.array_equal(mask.pixels, part_mask(seen(pixels)).pixels)
    (note,) = mask.notes
    assert str(note).startswith("skipped: 30 loose things beside the part, 2.4 mm2 or less")
    assert len(note.places) == 20
    x, y = np.array(note.places).T
    assert y.min() > (HEIGHT - 20) * SCALE
    assert x.max() < WIDTH * SCALE
    parts = part_mask(seen(chips(pixels, 30)), accept=["specks"])
    assert cv2.connectedComponents(parts.pixels)[0] - 1 == 31


def test_a_chip_at_the_border_does_not_refuse_the_part() -> None:
    pixels = scene(60, 200, noise=0.0, blur=0.3)
    pixels[:30, 300:306] = 60
    assert overlap(part_mask(seen(pixels))) > 0.9999
    with pytest.raises(InputError, match="touches the border"):
        part_mask(seen(pixels), accept=["specks"])


def test_a_mask_that_no_part_dominates_is_refused() -> None:
    mask = np.zeros((400, 400), np.uint8)
    mask[100:140, 100:140] = 255
    rng = np.random.default_rng(5)
    for u, v in rng.integers(5, 395, (900, 2)).tolist():
        mask[v : v + 2, u : u + 2] = 255
    with pytest.raises(NoSafeProgram, match=r"no part dominates the mask: 1 piece .* smaller ones"):
        clean_mask(mask.copy(), seen(mask.copy()), 1.0, "swarf.png")
    (note,) = clean_mask(mask, seen(mask.copy()), 1.0, "swarf.png", accepts_specks=True)
    assert "left out" in str(note)


def test_a_thin_ring_is_a_speck_and_the_disc_in_it_is_not() -> None:
    mask = np.zeros((200, 200), np.uint8)
    cv2.circle(mask, (100, 100), 80, 255, 1)
    cv2.circle(mask, (100, 100), 40, 255, -1)
    disc = np.count_nonzero(mask[100 - 45 : 100 + 46, 100 - 45 : 100 + 46])
    (note,) = clean_mask(mask, seen(mask.copy()), 1000 * SCALE**2, "ring.png")
    assert np.count_nonzero(mask) == disc
    assert note.what.startswith("1 speck below 40 mm2 left out")


def test_pixels_that_the_photo_does_not_show_are_neither_part_nor_bench() -> None:
    pixels = scene(60, 200)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    valid = (x + y > 140) & (x - y < 500)
    pixels[~valid] = 0
    mask = part_mask(seen(pixels, valid))
    assert overlap(mask) > 0.998
    assert not mask.pixels[~valid].any()
    assert np.abs(edge_errors(mask, DISC, sectors=8)[0]).max() < 0.03
    cut = x < 440
    pixels[~cut] = 200
    with pytest.raises(
        InputError, match=r"^part\.png: the part, or something .* touches the border"
    ):
        part_mask(seen(pixels, cut), name="part.png")


def test_invert_takes_the_side_that_a_note_reports_as_left_out() -> None:
    light_disc, dark_disc = covered((120.0, 240.0, 70.0)), covered((430.0, 240.0, 90.0))
    pixels = scene(0, 128 + 110 * light_disc - 100 * dark_disc, shape=np.zeros_like(SHAPE))
    mask = part_mask(seen(pixels))
    assert mask.dark
    assert overlap(mask, dark_disc) > 0.997
    assert str(mask.notes[0]).startswith(
        "warning: what is lighter than the bench is not taken for the part (it is 5"
    )
    other = part_mask(seen(pixels), invert=True)
    assert overlap(other, light_disc) > 0.997
    assert not other.dark


def test_a_given_threshold_off_the_middle_is_kept_and_noted() -> None:
    mask = part_mask(seen(scene(60, 200)), threshold=160)
    assert (mask.method, mask.level) == ("threshold", 160.0)
    assert str(mask.notes[0]) == (
        "warning: the threshold 160 is not halfway between part and bench (130) "
        "(the outline lies beside the edge, by a part of its blur)"
    )


BLANK = (
    "part.png: shows no part: nothing in it stands out from the bench along its border; "
    "put the part on a bench of"
)
OUTSIDE = "; leave bench around the whole part, crop or cover what is not the part"


@pytest.mark.parametrize(
    ("picture", "line"),
    [
        (
            lambda: scene(0, 150, shape=np.zeros_like(SHAPE)),
            f"{BLANK} another colour, in even light, or choose another [image] mask",
        ),
        (
            lambda: np.full((HEIGHT, WIDTH), 150, np.uint8),
            f"{BLANK} another colour, in even light, or choose another [image] mask",
        ),
        (
            lambda: np.ascontiguousarray(scene(60, 200)[:, 200:]),
            "part.png: the part, or something as dark or bright, touches the border of the picture"
            " (near x 0.1, y 74.5 mm)" + OUTSIDE,
        ),
        (
            lambda: np.ascontiguousarray(
                scene(60, 200, shape=covered((60.0, 240.0, 12.0)), noise=0.0)[:, :60]
            ),
            "part.png: the part, or something as dark or bright, touches the border of the picture"
            " (near x 11.9, y 45.7 mm)" + OUTSIDE,
        ),
        (
            lambda: scene(60, 200, shape=covered((300.0, 240.0, 2.5))),
            "part.png: shows no part of 1 mm2 or more, only 1 speck of 0.84 mm2 in all; "
            "check its scale, set [image] min_area lower, or choose another [image] mask",
        ),
    ],
)
def test_a_picture_without_a_whole_part_is_refused(picture: object, line: str) -> None:
    assert refuse(InputError, seen(picture())) == line


def test_a_frame_or_a_part_that_fills_the_picture_is_refused() -> None:
    pixels = scene(60, 200)
    pixels[:8], pixels[-8:], pixels[:, :8], pixels[:, -8:] = 60, 60, 60, 60
    assert refuse(InputError, seen(pixels), threshold=130, invert=True) == (
        "part.png: the part fills the picture, or a frame surrounds it; "
        "leave bench around the whole part, crop what is not bench"
    )


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        (
            {"mask": "threshold"},
            '[image] mask: "threshold" needs [image] threshold; give it, or choose another',
        ),
        (
            {"mask": "background"},
            '[image] mask: "background" needs [image] background; give it, or choose another',
        ),
        (
            {"color": [1, 2, 300]},
            "[image] color: [1.0, 2.0, 300.0] is not a colour; "
            "give [red, green, blue], each 0 to 255",
        ),
        (
            {"background": seen(np.zeros((10, 20), np.uint8))},
            "[image] background: its picture and the photo differ: "
            "20 x 10 px in grey and 620 x 480 px in grey; "
            "take both with the same camera and settings, and treat both alike",
        ),
    ],
)
def test_an_invalid_setting_is_refused(settings: dict, line: str) -> None:
    assert refuse(JobError, seen(scene(60, 200)), **settings) == line


def test_a_grey_picture_is_refused_by_the_method_color() -> None:
    line = 'part.png: is grey; [image] mask = "color" needs a picture in colour'
    assert refuse(InputError, seen(scene(60, 200)), mask="color") == line


def test_a_large_part_on_a_bench_of_one_tone_is_found_by_the_empty_bench() -> None:
    """One tone does not determine gain and offset of the light. The part covers a third."""
    disc = (310.0, 240.0, 190.0)
    empty = seen(scene(0, 200, shape=0 * SHAPE))
    mask = part_mask(seen(scene(60, 190, shape=covered(disc))), empty)
    assert overlap(mask, covered(disc)) > 0.998
    assert np.abs(edge_errors(mask, disc, sectors=8)[0]).max() < 0.03


@pytest.mark.parametrize("light", [(0.85, 12), (0.6, 0), (1.2, -10)])
@pytest.mark.parametrize("part", [40.0, 230.0])
def test_a_part_on_a_textured_board_with_a_plain_rim_is_found_by_the_empty_bench(
    part: float, light: tuple[float, float]
) -> None:
    """The board determines gain and offset of the light, the rim does not. The part is even."""
    rng = np.random.default_rng(2)
    grain = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 2.0)
    bench = np.full((HEIGHT, WIDTH), 40.0)
    board = 130 + 25 * np.clip(grain / grain.std(), -2, 2)
    bench[40:-40, 40:-40] = board[40:-40, 40:-40]
    empty = seen(np.clip(np.rint(bench), 0, 255).astype(np.uint8))
    photo = light[0] * (bench + (part - bench) * SHAPE) + light[1]
    photo += rng.normal(0, 1.0, photo.shape)
    mask = part_mask(seen(np.clip(np.rint(photo), 0, 255).astype(np.uint8)), empty)
    assert overlap(mask) > 0.995


@pytest.mark.parametrize("colour", [1.0, (0.8, 0.9, 1.0)])
def test_photos_with_two_lamps_leave_no_shadow(colour: object) -> None:
    """Lamps of different strength cast shadows on opposite sides, on a bench with grain."""
    grain = cv2.GaussianBlur(np.random.default_rng(2).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 2.0)
    bench = 170 + 6 * grain / grain.std()
    pictures = []
    for shift, light in (((10, 14), 1.0), ((-9, -12), 0.8)):
        shadow = cv2.GaussianBlur(np.roll(SHAPE, shift, (0, 1)), (0, 0), 1.0)
        shaded_bench = bench * (1 - 0.4 * shadow)
        if colour != 1.0:
            shaded_bench = shaded_bench[..., None] * np.array(colour)
        pictures.append(scene(70 * light, shaded_bench * light))
    lit = remove_shadows(*pictures, "lamp.png")
    mask = part_mask(seen(lit))
    assert overlap(mask) > 0.998
    assert mask.doubt is None
    assert part_mask(seen(pictures[0]), mask="otsu").doubt is not None


def test_a_photo_of_another_bench_is_refused() -> None:
    """The two pictures differ everywhere, also along the border."""
    rng = np.random.default_rng(9)
    pictures = []
    for _ in range(2):
        grain = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 8)
        pictures.append(np.clip(128 + 50 * grain / grain.std(), 0, 255).astype(np.uint8))
    with pytest.raises(InputError, match=r"^lamp.png: the photo with the lamp moved shows another"):
        remove_shadows(pictures[0], pictures[1], "lamp.png")
    assert refuse(InputError, seen(pictures[0]), seen(pictures[1])) == (
        "part.png: the photo of the empty bench shows another place, or the camera was moved; "
        "take both with the camera fixed, or choose another [image] mask"
    )


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2), (3, 5), (40, 3)])
@pytest.mark.parametrize("method", ["auto", "otsu", "adaptive", "color"])
def test_a_tiny_picture_is_refused(shape: tuple[int, int], method: str) -> None:
    rng = np.random.default_rng(1)
    for pixels in (
        np.zeros((*shape, 3), np.uint8),
        rng.integers(0, 255, (*shape, 3)).astype(np.uint8),
    ):
        with pytest.raises(CamgenError):
            part_mask(seen(pixels), mask=method)


def test_cells_and_tiles_lie_where_their_pixels_are() -> None:
    """Interpolated cells and tiles give a ramp again, except within half a cell of the border."""
    y, x = np.mgrid[:700, :1501]
    ramp = (x * 0.1 + y * 0.05).astype(np.float32)
    cells = make_cells(np.dstack([ramp] * 3).astype(np.uint8), None)
    assert cells.size == 2
    exact = cv2.resize(ramp[:, :1500], (750, 350), interpolation=cv2.INTER_AREA)
    for rows, values in interpolate_strips(exact, 2, ramp.shape):
        assert np.abs(values - ramp[rows])[1:-1, 1:-2].max() < 1e-4
    tiles = cv2.resize(ramp[:, :1500], (15, 7), interpolation=cv2.INTER_AREA)
    errors = np.abs(interpolate_tiles(tiles, 100, (700, 1500)) - ramp[:, :1500])
    assert errors[50:-50, 50:-50].max() < 1e-3


IMAGES = Path(__file__).parents[2].parent / "shared" / "data" / "image"
#: Minimum and maximum number of parts in each picture, by the list of the pictures. Shadows and
#: dots count as parts.
COUNTS = {
    "scikit-image/coins.png": (24, 24),
    "scikit-image/horse.png": (1, 1),
    "mexopencv/bw.png": (4, 4),
    "mexopencv/shape14.png": (1, 1),
    "mexopencv/shape18.png": (1, 1),
    "mexopencv/pic3.png": (4, 4),
    "mexopencv/pic1.png": (6, 7),
    "mexopencv/acircles_pattern.png": (44, 44),
    "ideas-simple_gear_tooth_counter/3.jpg": (1, 1),
    "ideas-simple_gear_tooth_counter/6.jpg": (1, 1),
    "aulas/engrenagem1.jpg": (1, 4),
    "Measuring-size-of-objects-in-an-image/sizes.jpg": (6, 6),
}


@pytest.mark.skipif(not IMAGES.exists(), reason="the shared pictures are not beside the repository")
@pytest.mark.parametrize("name", COUNTS)
def test_the_parts_of_shared_pictures_are_counted(name: str) -> None:
    mask = part_mask(make_scaled_view(read_picture(source(IMAGES / name)), mm_per_px=0.1))
    minimum, maximum = COUNTS[name]
    assert minimum <= cv2.connectedComponents(mask.pixels)[0] - 1 <= maximum


def lit(kind: str) -> np.ndarray:
    """Grey values of an empty bench under uneven light."""
    v, u = np.mgrid[0:480, 0:620] / 480
    upper_left = np.exp(-((u - 0.2) ** 2 + (v - 0.2) ** 2) * 8)
    lower_right = np.exp(-((u - 1.1) ** 2 + (v - 0.8) ** 2) * 8)
    return {
        "lamp": 120 + 60 * lower_right,
        "two lamps": 90 + 60 * upper_left + 50 * lower_right,
    }[kind]


def shaded(part: float, shade: float, soft: float) -> np.ndarray:
    """The part and its cast shadow on a light bench."""
    shadow = cv2.GaussianBlur(np.roll(SHAPE, (14, 22), axis=(0, 1)), (0, 0), soft)
    return scene(part, 200 - (200 - shade) * shadow)


@pytest.mark.parametrize("soft", [1, 6])
@pytest.mark.parametrize(("part", "shade"), [(60, 80), (60, 120), (90, 120), (90, 140), (110, 140)])
def test_a_cast_shadow_is_noted_and_marked_as_doubt(part: float, shade: float, soft: float) -> None:
    mask = part_mask(seen(shaded(part, shade, soft)))
    note = next(note for note in mask.notes if "part or bench by the method" in note.what)
    assert note.kind == "warning"
    assert mask.doubt is not None
    assert mask.doubt.shape == mask.pixels.shape
    # The doubt covers the shadow and its border, not the part.
    assert np.mean(INSIDE[mask.doubt > 0]) < 0.1
    for x, y in note.places:
        assert 0 < x < 620 * SCALE
        assert 0 < y < 480 * SCALE


def test_a_pale_part_beside_a_dark_shadow_is_whole() -> None:
    """The part differs from the bench by 12 grey values, the shadow by 80.

    Thresholds that the shadow pulls down would leave holes in the part.
    """
    shadow = np.clip(np.roll(SHAPE, (10, 14), axis=(0, 1)) - SHAPE, 0, 1)
    mask = part_mask(seen(scene(150, 162 - 80 * shadow, noise=1.0)))
    assert np.all(mask.pixels[INSIDE] == 255)


def brushed(strength: float) -> np.ndarray:
    """Streaks along x, whose standard deviation is `strength` in grey values."""
    grain = np.random.default_rng(5).normal(0, 1, (HEIGHT, WIDTH))
    streaks = cv2.GaussianBlur(grain, (0, 0), sigmaX=8, sigmaY=1)
    return strength * streaks / streaks.std()


@pytest.mark.parametrize("part", [100, 220])
def test_a_part_on_a_rough_bench_is_whole(part: float) -> None:
    """The part differs from the bench by 60 grey values, 5 times the deviation of the streaks."""
    pixels = scene(part, 160 + brushed(12.0), noise=1.0)
    mask = part_mask(seen(pixels))
    inside = cv2.erode(SHAPE, np.ones((15, 15))) > 0.5
    outside = cv2.dilate(SHAPE, np.ones((15, 15))) < 0.5
    assert np.all(mask.pixels[inside] == 255)
    assert np.mean(mask.pixels[outside] > 0) < 0.002


@pytest.mark.parametrize(("part", "shade"), [(60, 120), (90, 140), (220, 200)])
def test_a_shadow_with_the_outline_of_the_part_is_left_out(part: float, shade: float) -> None:
    """The shadow is moved by 26 px, on a bench of 200. A part of 220 is lighter than the bench."""
    mask = part_mask(seen(shaded(part, shade, 1)))
    left_out = [note for note in mask.notes if "the outline of the part, moved" in note.what]
    assert bool(left_out) == (part < 200)
    rim = cv2.dilate(SHAPE, np.ones((5, 5))) - cv2.erode(SHAPE, np.ones((5, 5))) > 0
    assert np.mean(((mask.pixels > 0) != (SHAPE > 0.5))[~rim]) < 1e-3
    if left_out:
        assert left_out[0].kind == "warning"
        assert "by 26 px" in left_out[0].why


def test_a_dark_area_without_the_outline_of_the_part_belongs_to_the_part() -> None:
    """The dark area is the lower third of the disc, or a band along its whole border."""
    lower = np.arange(HEIGHT)[:, None] > DISC[1] + DISC[2] / 3
    band = SHAPE - cv2.erode(SHAPE, np.ones((31, 31)))
    for area in (lower * SHAPE, band):
        mask = part_mask(seen(scene(60 + 50 * area, 200)))
        assert not [note for note in mask.notes if "the outline of the part, moved" in note.what]
        assert np.all(mask.pixels[INSIDE] == 255)


@pytest.mark.parametrize("noise", [0.0, 2.0, 5.0])
@pytest.mark.parametrize("kind", ["lamp", "two lamps"])
def test_an_empty_bench_in_uneven_light_is_refused_or_warned_about(kind: str, noise: float) -> None:
    grey = lit(kind) + np.random.default_rng(1).normal(0, noise, (480, 620))
    try:
        mask = part_mask(seen(np.clip(np.rint(grey), 0, 255).astype(np.uint8)))
    except (InputError, NoSafeProgram):
        return
    assert any(note.kind == "warning" for note in mask.notes)


def test_a_clear_part_leaves_no_doubt() -> None:
    for pixels in (
        scene(60, 200),
        scene(200, 70, slope=0.5),
        scene(RED, GREEN),
        scene(60, 200, noise=8, blur=2.5),
    ):
        assert part_mask(seen(pixels)).doubt is None


#: Colours of benches and parts, BGR.
WOOD, BLUE = (110.0, 150.0, 190.0), (120.0, 60.0, 40.0)
BRASS, STEEL = (70.0, 150.0, 190.0), (170.0, 170.0, 170.0)


@pytest.mark.parametrize("shade", [0.5, 0.75])
@pytest.mark.parametrize(
    ("part", "bench"), [(BLUE, WOOD), ((60.0, 60.0, 60.0), WOOD), (BRASS, BLUE), (STEEL, WOOD)]
)
def test_a_shadow_with_the_colour_of_the_bench_is_left_out(
    part: tuple[float, ...], bench: tuple[float, ...], shade: float
) -> None:
    """The shadow lies 14 px to the right of the part and 10 px below it."""
    shadow = cv2.GaussianBlur(np.roll(SHAPE, (10, 14), (0, 1)), (0, 0), 1.0)[..., None]
    mask = part_mask(seen(scene(part, np.array(bench) * (1 - (1 - shade) * shadow))))
    assert overlap(mask) > 0.997
    assert mask.doubt is None
    assert len(mask.notes) <= 1
    assert not mask.notes or str(mask.notes[0]).startswith("warning: a shadow beside the part")


@pytest.mark.parametrize("method", ["otsu", "adaptive"])
def test_each_method_marks_a_shadow_as_doubt(method: str) -> None:
    assert part_mask(seen(shaded(60, 120, 1)), mask=method).doubt is not None
    assert part_mask(seen(scene(60, 200)), mask=method).doubt is None


def drawn_on_bench(*parts: tuple[float, float, float, float, float]) -> np.ndarray:
    """Dark ellipses on a light bench, 600 x 400 px: u, v, two half axes in px, rotation in deg."""
    fine = np.zeros((1600, 2400), np.uint8)
    for u, v, a, b, angle in parts:
        centre, axes = (round(4 * u), round(4 * v)), (round(4 * a), round(4 * b))
        cv2.ellipse(fine, centre, axes, angle, 0, 360, 255, cv2.FILLED)
    grey = 200 - 140 / 255 * cv2.resize(fine, (600, 400), interpolation=cv2.INTER_AREA)
    return np.rint(grey + np.random.default_rng(2).normal(0, 2, grey.shape)).astype(np.uint8)


def find_meetings(pixels: np.ndarray) -> list[tuple[float, float]]:
    """Points (u, v) px at which the notes report that parts touch or overlap."""
    notes = [note for note in part_mask(seen(pixels)).notes if "touch or overlap" in note.what]
    assert all(note.kind == "warning" for note in notes)
    places = chain.from_iterable(note.places for note in notes)
    return [(x / SCALE, len(pixels) - y / SCALE) for x, y in places]


def test_parts_that_touch_or_overlap_are_noted() -> None:
    for depth in (0, 4, 10):
        parts = (200, 200, 80, 80, 0), (340 - depth, 200, 60, 60, 0)
        [(u, v)] = find_meetings(drawn_on_bench(*parts))
        assert abs(u - 280) < 12
        assert abs(v - 200) < 4
    row = [(120, 200, 60, 40, 0), (238, 200, 60, 60, 0), (340, 250, 55, 55, 0)]
    assert len(find_meetings(drawn_on_bench(*row))) == 2
    assert (
        len(find_meetings(drawn_on_bench((200, 200, 110, 50, 10), (415, 200, 110, 50, -10)))) == 1
    )


def test_separate_parts_and_single_parts_are_not_noted_as_touching() -> None:
    assert not find_meetings(drawn_on_bench((200, 200, 80, 80, 0), (346, 200, 60, 60, 0)))
    assert not find_meetings(drawn_on_bench((300, 200, 150, 60, 30)))
    # A tee, a star and an I-beam are single parts.
    tee = np.full((400, 600), 200, np.uint8)
    tee[80:140, 150:450], tee[140:320, 270:330] = 60, 60
    assert not find_meetings(tee)
    star = np.full((400, 600), 200, np.uint8)
    rim = np.where(np.arange(10) % 2, 70, 180) * np.exp(1j * np.pi * np.arange(10) / 5) + 300 + 200j
    cv2.fillPoly(star, [np.column_stack([rim.real, rim.imag]).round().astype(np.int32)], 60)
    assert not find_meetings(star)
    beam = np.full((400, 600), 200, np.uint8)
    beam[60:110, 150:450], beam[290:340, 150:450], beam[110:290, 270:330] = 60, 60, 60
    assert not find_meetings(beam)
    assert not find_meetings(scene(60, 200))
