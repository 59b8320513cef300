"""The drawing robot from end to end: a gear and a board for a SCARA, the V+ text judged by the arm's formulas."""

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
#: Where it does not matter which stroke comes first.
AS_DRAWN = ["--set", "tour.method=as-drawn"]
BOARD = ["--set", "operation.kind=fill", "--set", "tool.diameter=0.8"]
ARM = ["--set", "cell.robot=Cobra s600"]
SPACE = "{http://www.w3.org/2000/svg}"

#: Cobra s600: links and height of the flange with joint 3 at 0, mm; ranges of its joints, deg and mm.
INNER, OUTER, HIGH = 325.0, 275.0, 387.0
LIMITS = ((-105.0, 105.0), (-150.0, 150.0), (0.0, 210.0))
#: Work frame in the base and length of the tool, as the post's own cell has them.
WORK, TOOL = (250.0, -75.0, 150.0), 100.0


def program(tmp_path: Path, name: str, *words: str) -> str:
    target = tmp_path / f"{Path(name).stem}.v2"
    assert (
        main(["build", str(PARTS / name), "--post", "vplus", *words, "-q", "-o", str(target)]) == 0
    )
    return target.read_text()


def targets(text: str) -> list[list[float]]:
    return [
        [float(v) for v in found.split(",")]
        for found in re.findall(r"MOVES? cg\.work:TRANS\(([^)]*)\)", text)
    ]


@pytest.mark.parametrize(("home", "posture"), [(45, "RIGHTY"), (-45, "LEFTY")])
@pytest.mark.parametrize(("name", "words"), [("gear.png", GEAR), ("board.png", BOARD)])
def test_every_pose_of_the_text_is_in_reach_with_the_tool_down(
    tmp_path: Path, name: str, words: list[str], home: int, posture: str
) -> None:
    text = program(
        tmp_path, name, *words, *ARM, *AS_DRAWN, "--set", f"cell.home=[0, {home}, 50, 0]"
    )
    assert re.findall(r"^ +(LEFTY|RIGHTY)$", text, re.MULTILINE) == [posture]
    assert text.index(posture) < text.index("TRANS(", text.index("PPOINT"))
    assert f"SET cg.work = TRANS({WORK[0]:g},{WORK[1]:g},{WORK[2]:g},0,0,0)" in text
    poses = targets(text)
    assert len(poses) > 100
    for x, y, z, yaw, pitch, _ in poses:
        # Straight down, in the form that a SCARA takes.
        assert (yaw, pitch) == (0, 180)
        along, across = WORK[0] + x, WORK[1] + y
        cosine = (along**2 + across**2 - INNER**2 - OUTER**2) / (2 * INNER * OUTER)
        elbow = math.copysign(math.acos(cosine), home)
        shoulder = math.atan2(across, along) - math.atan2(
            OUTER * math.sin(elbow), INNER + OUTER * math.cos(elbow)
        )
        joints = math.degrees(shoulder), math.degrees(elbow), HIGH - (WORK[2] + z + TOOL)
        for value, (least, most) in zip(joints, LIMITS, strict=True):
            assert least <= value <= most


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
def test_a_page_where_the_arm_cannot_draw_is_refused_with_the_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], frame: str, words: str
) -> None:
    target = tmp_path / "gear.v2"
    asked = [*GEAR, *ARM, *AS_DRAWN, "--set", f"cell.base_from_work={frame}", "-o", str(target)]
    assert main(["build", str(PARTS / "gear.png"), "--post", "vplus", *asked]) == 3
    said = capsys.readouterr().err
    assert words in said
    assert "cell.base_from_work" in said
    assert not target.exists()


def test_without_a_scale_the_user_is_told_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gear.png").write_bytes((PARTS / "gear.png").read_bytes())
    assert main(["build", "gear.png", "--post", "vplus"]) == 2
    assert "give [page] size to draw it on paper" in capsys.readouterr().err
    # What it says, in a job file beside the picture, is all that is needed.
    (tmp_path / "gear.toml").write_text('[page]\nsize = "A5"\n')
    assert main(["build", "gear.png", "--post", "vplus", "-q"]) == 0
    assert (tmp_path / "gear.v2").exists()


def test_the_stages_of_a_drawing_are_shown(tmp_path: Path) -> None:
    for name, words, count, fourth in (
        ("gear.png", GEAR, 6, r"4 lines and 14 arcs, \d+ points"),
        ("board.png", BOARD, 7, r"4 lines of a pen of 0\.8 mm"),
    ):
        picture = tmp_path / "stages.svg"
        program(tmp_path, name, *words, "--preview", str(picture))
        root = ElementTree.parse(picture).getroot()
        texts = [text.text or "" for text in root.iter(f"{SPACE}text")]
        panels = [text for text in texts if text[:1].isdigit()]
        assert [text[0] for text in panels] == list("1234567")[:count]
        assert re.fullmatch(fourth, panels[3])
        # The paper's figures 6 and 7: the same strokes, and less way with the pen up.
        found, run = (
            re.search(r"(\d+) strokes, pen up ([\d.]+) mm, (.*)", text).groups()
            for text in panels[-2:]
        )  # type: ignore[union-attr]
        assert (found[2], run[2], found[0]) == ("as found", "by order", run[0])
        assert float(run[1]) < float(found[1])
    # The board has no page of its own: 591 x 472 px at 300 per inch and a row of paper around them.
    assert panels[6].startswith("7 50.2 x 40.1 mm: ")
    # Between two strokes the pen goes one way, as thin line.
    count = int(re.findall(r"(\d+) strokes", panels[6])[0])
    ways = [path for path in root.iter(f"{SPACE}path") if path.get("class") == "up"]
    assert [up.get("d", "").count("M") for up in ways] == [count - 1] * 2
    colours = [path.get("stroke") for path in root.iter(f"{SPACE}path") if path.get("stroke")]
    assert len(set(colours)) == count


def test_the_map_of_what_is_covered_lies_on_the_ink(tmp_path: Path) -> None:
    """Green and red are the copper: they end where the black of the second panel does, and nearly all is green."""
    picture = tmp_path / "stages.svg"
    program(tmp_path, "board.png", *BOARD, "--preview", str(picture))
    root = ElementTree.parse(picture).getroot()
    images = [one for one in root.iter(f"{SPACE}image") if "image/png" in one.get("href", "")]
    coded = [b64decode(one.get("href", "").partition(",")[2]) for one in images]
    ink, found = (cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) for data in coded)
    (group,) = (one for one in root.iter(f"{SPACE}g") if images[1] in one)
    at = [float(word) for word in re.findall(r"-?[\d.]+", group.get("transform", ""))]
    green, red = ((found == colour).all(axis=2) for colour in COLOURS[1:3])
    assert green.sum() > 0.98 * (green | red).sum() > 0

    def ends(mask: np.ndarray, image: ElementTree.Element, corner: list[float]) -> list[float]:
        size = float(image.get("width", "")), float(image.get("height", ""))
        places = [np.flatnonzero(mask.any(axis=k)) for k in (0, 1)]
        spans = [(k, size[k] / mask.shape[1 - k]) for k in (0, 1)]
        return [
            corner[k] + pixel * end
            for k, pixel in spans
            for end in (places[k].min(), places[k].max() + 1)
        ]

    assert ends(green | red, images[1], at) == pytest.approx(
        ends(ink[:, :, 0] < 128, images[0], [0.0, 0.0]), abs=0.3
    )
