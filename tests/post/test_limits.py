"""Limits of the tolerance of a post, and the words that select the compared properties."""

import math
from pathlib import Path

import pytest
from msgspec.structs import replace

from camgen.cli import main
from camgen.model.errors import JobError
from camgen.pipeline import build
from camgen.pipeline.stages import part
from camgen.post import Post, Tolerance
from camgen.post.limits import BOUNDS, limit_tolerance
from camgen.post.plugins import find_post, make_post
from camgen.post.verify import COMPARED, list_uncompared

BRACKET = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
POSTS = ("gcode", "grbl", "pacscript", "rapid", "vplus")
#: The tolerance of some post.
TOLERANCE = Tolerance(0.0005, 1e-6, 1e-6, 0.01, 0.01, 0.001)


@pytest.mark.parametrize(
    ("mm", "chord", "limit"),
    [(0.0005, 0.01, 0.0005), (0.005, 0.01, 0.005), (0.01, 0.01, 0.01), (0.0501, 0.05, 0.05)],
)
def test_the_tolerance_of_a_text_is_at_most_the_chord_error(mm, chord, limit):
    tolerance = replace(TOLERANCE, mm=mm)
    assert limit_tolerance(tolerance, chord) == replace(tolerance, mm=limit)


@pytest.mark.parametrize(
    ("mm", "chord"), [(0.05, 0.01), (50.0, 0.01), (0.0103, 0.01), (5e-4, 1e-4)]
)
def test_a_coarser_text_than_the_job_allows_is_refused(mm, chord):
    with pytest.raises(JobError, match=f"printed to {mm:g} mm, but tolerance.chord = ") as caught:
        limit_tolerance(replace(TOLERANCE, mm=mm), chord)
    assert caught.value.remedy == f"raise post.decimals, or set tolerance.chord = {mm:g}"


@pytest.mark.parametrize("name", ["arc_fit", "simplify", "corner"])
def test_a_tolerance_of_shapes_does_not_limit_the_digits(name):
    """0 switches the change of the shape off. It does not require more digits."""
    square = part([(0, 0), (40, 0), (40, 30), (0, 30), (0, 0)])
    assert build(square, post="rapid", job={"tolerance": {name: 0.0}}).deviation.max_mm <= 0.0005


@pytest.mark.parametrize("post", ["pacscript", "rapid", "vplus"])
def test_few_digits_need_a_wide_tolerance(post):
    """Half a digit of 0.1 mm is 0.05 mm, five times the default of tolerance.chord."""
    with pytest.raises(JobError, match=r"printed to 0\.050?1? mm") as caught:
        build(BRACKET, post=post, job={"post": {"decimals": 1}})
    assert caught.value.exit_code == 2
    wide = {"post": {"decimals": 1}, "tolerance": {"chord": 0.05}}
    # The middle of an arc may deviate by six times as much as a coordinate (ARC_SLACK).
    assert build(BRACKET, post=post, job=wide).deviation.max_mm <= 6 * 0.0501


@pytest.mark.parametrize("post", POSTS)
def test_a_text_with_two_digits_is_within_the_default_tolerance(post):
    assert build(BRACKET, post=post, job={"post": {"decimals": 2}}).deviation.max_mm < 6 * 0.006


def test_a_coarse_post_ends_a_build_before_it_prints(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = ["build", str(BRACKET), "--post", "rapid", "--set", "post.decimals=0", "-q"]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert "coordinates are printed to 0.5 mm, but tolerance.chord = 0.01" in error
    assert "raise post.decimals, or set tolerance.chord = 0.5" in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("post", POSTS)
def test_no_built_in_post_is_beyond_a_bound(post):
    tolerance = make_post(find_post(post), {}).tolerance()
    for name, bound in BOUNDS.items():
        assert 0 <= getattr(tolerance, name) <= bound


# The words that select the compared properties


def test_the_verified_fields_of_the_base_are_words_of_the_table():
    assert Post.verified_fields <= set(COMPARED)


@pytest.mark.parametrize("name", POSTS)
def test_an_aspect_without_a_word_is_listed_as_not_compared(name):
    post = make_post(find_post(name), {})
    missing = set(list_uncompared(post))
    for word in post.list_verified():
        assert missing.isdisjoint(COMPARED[word].aspects)
    aspects, covered = set(), set()
    for word, compared in COMPARED.items():
        aspects.update(compared.aspects)
        if word in post.list_verified():
            covered.update(compared.aspects)
    assert missing == aspects - covered


def test_a_post_with_few_words_lists_the_aspects_that_are_not_compared():
    class Mute(find_post("rapid")):
        verified_fields = frozenset({"orientation", "blend"})

    assert list_uncompared(make_post(Mute, {"declare": False, "conf": "off"})) == [
        "the work frame",
        "the tool frame",
        "orientations half-way along arcs",
        "speeds of joint motions",
        "speeds of linear and circular motions",
        "speeds of reorientations",
        "postures of the arm",
        "directions of forces",
    ]


def test_each_bound_is_the_one_of_its_reason():
    """The reasons are 100 mm and 1 m of distance, and 1 % of 10 mm/s, 10 N and 6 deg/s."""
    assert 100 * BOUNDS["angle"] == pytest.approx(0.0087, abs=1e-4)
    assert 1000 * BOUNDS["joint"] == pytest.approx(0.0175, abs=1e-4)
    assert BOUNDS["speed"] == pytest.approx(0.01 * 10)
    assert BOUNDS["force"] == pytest.approx(0.01 * 10)
    assert BOUNDS["turn"] == pytest.approx(0.01 * math.radians(6), rel=0.05)
    assert set(BOUNDS) == set(Tolerance.__struct_fields__) - {"mm"}
