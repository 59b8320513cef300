"""The drawing robot from picture to V+ text: a gear and a board for a SCARA.

The text is tested by the formulas of the arm.
"""

import math
import re
from base64 import b64decode
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from camgen.cli import main
from camgen.plan.fill.cover import COLOURS

PARTS = Path(__file__).parents[1] / "fixtures" / "parts"
GEAR = ["--set", "page.size=A5"]
#: For tests in which the order of the strokes does not matter.
AS_DRAWN = ["--set", "tour.method=as-drawn"]
BOARD = ["--set", "operation.kind=fill", "--set", "tool.diameter=0.8"]
ARM = ["--set", "cell.robot=Cobra s600"]
SPACE = "{http://www.w3.org/2000/svg}"

#: Cobra s600: lengths of its links and height of the flange with joint 3 at 0, mm, and ranges of
#: its joints, deg and mm.
INNER, OUTER, HEIGHT = 325.0, 275.0, 387.0
LIMITS = ((-105.0, 105.0), (-150.0, 150.0), (0.0, 210.0))
#: Work frame in the base and length of the tool, mm, of the built-in cell of the post.
WORK, TOOL = (250.0, -75.0, 150.0), 100.0


def write_program(tmp_path: Path, name: str, *words: str) -> str:
    target = tmp_path / f"{Path(name).stem}.v2"
    assert (
        main(["build", str(PARTS / name), "--post", "vplus", *words, "-q", "-o", str(target)]) == 0
    )
    return target.read_text()


def list_targets(text: str) -> list[list[float]]:
    """The six values of each target in the text, mm and deg."""
    targets: list[list[float]] = []
    for values in re.findall(r"MOVES? cg\.work:TRANS\(([^)]*)\)", text):
        targets.append([float(value) for value in values.split(",")])
    return targets


@pytest.mark.parametrize(("home", "posture"), [(45, "RIGHTY"), (-45, "LEFTY")])
@pytest.mark.parametrize(("name", "words"), [("gear.png", GEAR), ("board.png", BOARD)])
def test_all_poses_of_the_text_are_within_reach_with_the_tool_down(
    tmp_path: Path, name: str, words: list[str], home: int, posture: str
) -> None:
    text = write_program(
        tmp_path, name, *words, *ARM, *AS_DRAWN, "--set", f"cell.home=[0, {home}, 50, 0]"
    )
    assert re.findall(r"^ +(LEFTY|RIGHTY)$", text, re.MULTILINE) == [posture]
    assert text.index(posture) < text.index("TRANS(", text.index("PPOINT"))
    assert f"SET cg.work = TRANS({WORK[0]:g},{WORK[1]:g},{WORK[2]:g},0,0,0)" in text
    poses = list_targets(text)
    assert len(poses) > 100
    for x, y, z, yaw, pitch, _ in poses:
        # The tool is straight down, in the form for a SCARA.
        assert (yaw, pitch) == (0, 180)
        ahead, aside = WORK[0] + x, WORK[1] + y
        cosine = (ahead**2 + aside**2 - INNER**2 - OUTER**2) / (2 * INNER * OUTER)
        elbow = math.copysign(math.acos(cosine), home)
        shoulder = math.atan2(aside, ahead) - math.atan2(
            OUTER * math.sin(elbow), INNER + OUTER * math.cos(elbow)
        )
        joints = math.degrees(shoulder), math.degrees(elbow), HEIGHT - (WORK[2] + z + TOOL)
        for value, (lowest, highest) in zip(joints, LIMITS, strict=True):
            assert lowest <= value <= highest


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        ("[600, -75, 150, 0, 0, 0]", "gear.png: Cobra s600 cannot run path"),
        ("[-400, -75, 150, 0, 0, 0]", "J1 is beyond its limit by"),
        ("[250, -75, 300, 0, 0, 0]", "J3 is beyond its limit by"),
        (
            "[250, -105, 150, 10, 0, 0]",
            "a SCARA cannot tilt its tool, and this pose is 10 deg from straight down",
        ),
    ],
)
def test_a_page_out_of_reach_is_refused_with_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], frame: str, words: str
) -> None:
    target = tmp_path / "gear.v2"
    settings = [*GEAR, *ARM, *AS_DRAWN, "--set", f"cell.base_from_work={frame}", "-o", str(target)]
    assert main(["build", str(PARTS / "gear.png"), "--post", "vplus", *settings]) == 3
    message = capsys.readouterr().err
    assert words in message
    assert "cell.base_from_work" in message
    assert not target.exists()


def test_the_error_without_a_scale_recommends_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gear.png").write_bytes((PARTS / "gear.png").read_bytes())
    assert main(["build", "gear.png", "--post", "vplus"]) == 2
    assert "give [page] size to draw it on paper" in capsys.readouterr().err
    # The recommended setting in a job file beside the picture is enough.
    (tmp_path / "gear.toml").write_text('[page]\nsize = "A5"\n')
    assert main(["build", "gear.png", "--post", "vplus", "-q"]) == 0
    assert (tmp_path / "gear.v2").exists()


def test_the_stages_of_a_drawing_are_shown(tmp_path: Path) -> None:
    for name, words, count, fourth in (
        ("gear.png", GEAR, 6, r"4 lines and 14 arcs, \d+ points"),
        ("board.png", BOARD, 7, r"4 lines of a pen of 0\.8 mm"),
    ):
        picture = tmp_path / "stages.svg"
        write_program(tmp_path, name, *words, "--preview", str(picture))
        root = ElementTree.parse(picture).getroot()
        texts = [text.text or "" for text in root.iter(f"{SPACE}text")]
        panels = [text for text in texts if text[:1].isdigit()]
        assert [text[0] for text in panels] == list("1234567")[:count]
        assert re.fullmatch(fourth, panels[3])
        # Figures 6 and 7 of the paper: equal strokes, and less travel with the pen up.
        as_found, by_order = (
            re.search(r"(\d+) strokes, pen up ([\d.]+) mm, (.*)", text).groups()
            for text in panels[-2:]
        )  # type: ignore[union-attr]
        assert (as_found[2], by_order[2], as_found[0]) == ("as found", "by order", by_order[0])
        assert float(by_order[1]) < float(as_found[1])
    # The board has no page: 591 x 472 px at 300 px per inch, and one pixel of paper around them.
    assert panels[6].startswith("7 50.2 x 40.1 mm: ")
    # The link between two strokes is a thin line.
    count = int(re.findall(r"(\d+) strokes", panels[6])[0])
    links = [path for path in root.iter(f"{SPACE}path") if path.get("class") == "up"]
    assert [link.get("d", "").count("M") for link in links] == [count - 1] * 2
    colours = [path.get("stroke") for path in root.iter(f"{SPACE}path") if path.get("stroke")]
    assert len(set(colours)) == count


def test_the_map_of_the_covered_area_lies_on_the_ink(tmp_path: Path) -> None:
    """Green and red cover the copper, the black area of the second panel; nearly all is green."""
    picture = tmp_path / "stages.svg"
    write_program(tmp_path, "board.png", *BOARD, "--preview", str(picture))
    root = ElementTree.parse(picture).getroot()
    images = [
        element for element in root.iter(f"{SPACE}image") if "image/png" in element.get("href", "")
    ]
    coded = [b64decode(element.get("href", "").partition(",")[2]) for element in images]
    ink, cover = (cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) for data in coded)
    (group,) = (element for element in root.iter(f"{SPACE}g") if images[1] in element)
    shift = [float(word) for word in re.findall(r"-?[\d.]+", group.get("transform", ""))]
    green, red = ((cover == colour).all(axis=2) for colour in COLOURS[1:3])
    assert green.sum() > 0.98 * (green | red).sum() > 0

    def measure_ends(
        mask: np.ndarray, image: ElementTree.Element, corner: list[float]
    ) -> list[float]:
        """Lowest and highest x, then lowest and highest y, of the marked pixels of an image."""
        size = float(image.get("width", "")), float(image.get("height", ""))
        ends: list[float] = []
        for k in (0, 1):
            pixel = size[k] / mask.shape[1 - k]
            indices = np.flatnonzero(mask.any(axis=k))
            ends += [corner[k] + pixel * indices.min(), corner[k] + pixel * (indices.max() + 1)]
        return ends

    assert measure_ends(green | red, images[1], shift) == pytest.approx(
        measure_ends(ink[:, :, 0] < 128, images[0], [0.0, 0.0]), abs=0.3
    )
