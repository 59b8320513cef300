import math
import tomllib
from importlib import resources

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.model.errors import JobError
from camgen.model.pose import rotation_from_fixed_xyz
from camgen.robots.catalogue import find_robot, list_robots
from camgen.robots.kinematics.forward import compute_flange, compute_jacobian, compute_link_frames
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import are_within_limits, measure_excess
from camgen.robots.models import Robot
from camgen.robots.posture import ANY_FIGURE, abb_confdata, denso_figure, vplus_switches
from tests.support.arm_models import ARMS, SHARED, by_hand, shared_frames, shared_robot

STEMS = (
    "abb_irb120", "abb_irb1200_5_90", "abb_irb2000", "abb_irb2400_10", "adept_cobra_s600", "adept_viper_s650",
    "cnc_3axis", "denso_cobotta", "denso_vs060", "denso_vs6556", "denso_vs6577",
)  # fmt: skip


def some(of: Robot, count: int, seed: int = 0) -> np.ndarray:
    """Joint values (count, J) within all limits."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(of.limits[:, 0], of.limits[:, 1], (8 * count, len(of.joints)))
    return values[are_within_limits(of, values)][:count]


def units(of: Robot) -> np.ndarray:
    return np.array([1.0 if joint.sliding else math.degrees(1) for joint in of.joints])


def pose_of(of: Robot, *degrees: float) -> tuple[np.ndarray, np.ndarray]:
    rotations, origins = compute_flange(of, np.array([degrees]) / units(of))
    return rotations[0], origins[0]


def test_there_are_eleven_of_four_kinds() -> None:
    kinds = {of.name: of.kind for of in list_robots()}
    assert kinds == {
        **dict.fromkeys(ARMS, "spherical-wrist"),
        "Cobra s600": "scara", "3-axis mill": "cartesian", "COBOTTA": "serial",
    }  # fmt: skip


@pytest.mark.parametrize("name", ["IRB 2400", "irb2400", "IRB-2400", "abb_irb2400_10"])
def test_a_robot_is_found_however_its_name_is_spelled(name: str) -> None:
    assert find_robot(name).name == "IRB 2400"


@pytest.mark.parametrize(
    "file", [entry.name for entry in (resources.files("camgen.robots") / "data").iterdir()]
)
def test_a_file_is_called_like_one_of_the_names_of_its_robot(file: str) -> None:
    """By which it is found without a look at the others."""
    told = tomllib.loads((resources.files("camgen.robots") / "data" / file).read_text())
    stem = file.removesuffix(".toml")
    assert stem in [
        "".join(c for c in name.casefold() if c.isalnum()) for name in (told["name"], *told["also"])
    ]
    assert find_robot(stem).name == told["name"]


def test_the_nearest_robot_is_named() -> None:
    with pytest.raises(
        JobError, match=r"^robot irb 2401: there is no such robot; nearest is IRB 2400; "
    ):
        find_robot("irb 2401")


@pytest.mark.parametrize("name", ARMS)
def test_the_flange_is_where_a_table_of_denavit_and_hartenberg_puts_it(name: str) -> None:
    of = find_robot(name)
    joints = some(of, 50)
    rotations, origins = compute_flange(of, joints)
    for row, degrees in enumerate(np.degrees(joints)):
        expected = by_hand(name, degrees)
        assert np.abs(origins[row] - expected[:3, 3]).max() < 1e-9
        assert np.abs(rotations[row] - expected[:3, :3]).max() < 1e-12


def test_irb_120_at_zero_reaches_374_mm_ahead_at_630_mm() -> None:
    """270 + 290 + 70 up, 302 + 72 ahead; tool z ahead, tool x down: the quaternion 0.7071, 0, 0.7071, 0."""
    rotation, origin = pose_of(find_robot("IRB 120"), 0, 0, 0, 0, 0, 0)
    assert origin == pytest.approx([374, 0, 630], abs=1e-9)
    assert rotation == pytest.approx(np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]), abs=1e-12)


def test_the_rod_keeps_the_forearm_level() -> None:
    """IRB 2400 with axis 2 at 30 deg and axis 3 at 0: the forearm stays level, so that only the upper arm has moved."""
    rotation, origin = pose_of(find_robot("IRB 2400"), 0, 30, 0, 0, 0, 0)
    assert origin == pytest.approx(
        [100 + 705 * 0.5 + 755 + 85, 0, 615 + 705 * math.sqrt(0.75) + 135], abs=1e-9
    )
    assert rotation[:, 2] == pytest.approx([1, 0, 0], abs=1e-12)


def test_cobotta_with_its_arm_up_and_laid_ahead() -> None:
    """180 + 165 - 345 + 522.5 + 42 up, 12 back, 20 - 20 - 44.5 aside; J2 = 90 turns all above 180 about y."""
    of = find_robot("COBOTTA")
    assert pose_of(of, 0, 0, 0, 0, 0, 0)[1] == pytest.approx([-12, -44.5, 564.5], abs=1e-9)
    assert pose_of(of, 0, 90, 0, 0, 0, 0)[1] == pytest.approx([384.5, -44.5, 192], abs=1e-9)


def test_cobra_stretched_bent_and_let_down() -> None:
    of = find_robot("Cobra s600")
    assert pose_of(of, 0, 0, 0, 0)[1] == pytest.approx([600, 0, 387], abs=1e-9)
    rotation, origin = pose_of(of, 30, 60, 100, 0)
    assert origin == pytest.approx([325 * math.sqrt(0.75), 325 * 0.5 + 275, 287], abs=1e-9)
    assert rotation == pytest.approx(np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), abs=1e-12)
    # J4 turns clockwise seen from above: tool x from +y towards +x.
    assert pose_of(of, 30, 60, 100, 30)[0][:, 0] == pytest.approx(
        [0.5, math.sqrt(0.75), 0], abs=1e-12
    )


def test_the_viper_is_the_vs_6556_with_other_zeros() -> None:
    viper, denso = find_robot("Viper s650"), find_robot("VS-6556")
    joints = some(denso, 20)
    a = compute_flange(denso, joints)
    b = compute_flange(viper, joints + np.radians([0, -90, 90, 0, 0, 0]))
    assert np.abs(a[0] - b[0]).max() < 1e-12
    assert np.abs(a[1] - b[1]).max() < 1e-9
    assert viper.limits[:5] == pytest.approx(
        denso.limits[:5] + np.radians([0, -90, 90, 0, 0])[:, None]
    )


@pytest.mark.skipif(
    not SHARED.is_dir(), reason="the folder shared, with the descriptions of robots, is not there"
)
@pytest.mark.parametrize("stem", STEMS)
def test_models_are_as_described(stem: str) -> None:
    data, of = shared_robot(stem), find_robot(stem)
    order = [1, 0, 2] if stem == "cnc_3axis" else range(len(of.joints))  # Y, X, Z there
    unit = units(of)
    rows = [data["joint"][k] for k in order]
    assert of.limits * unit[:, None] == pytest.approx(
        np.array([[row["min"], row["max"]] for row in rows])
    )
    assert of.speeds * unit == pytest.approx([row["max_speed"] for row in rows])
    assert of.home * unit == pytest.approx(np.array(data["home"]["q"])[list(order)])
    assert [list(pair) for pair in of.touching] == data["collision"]["ignore_pairs"]
    boxes = [[[*box.link_from_box.origin, *box.half] for box in link.boxes] for link in of.links]
    assert boxes == [
        [[*box["center_mm"], *box["half_mm"]] for box in link["boxes"]] for link in data["link"]
    ]
    joints = some(of, 10)
    rotations, origins = compute_link_frames(of, joints)
    tips = compute_flange(of, joints)
    for row, values in enumerate(joints * unit):
        expected = shared_frames(data, values[list(order)])
        last = len(expected) - 2
        links = range(last, last + 1) if stem == "cnc_3axis" else range(last + 1)
        for k in links:
            assert np.abs(origins[row, k] - expected[k][:3, 3]).max() < 1e-9
            assert np.abs(rotations[row, k] - expected[k][:3, :3]).max() < 1e-12
        assert np.abs(tips[1][row] - expected[-1][:3, 3]).max() < 1e-9
        assert np.abs(tips[0][row] - expected[-1][:3, :3]).max() < 1e-12


@pytest.mark.parametrize("of", list_robots(), ids=lambda of: of.name)
def test_the_jacobian_is_the_slope_of_the_flange(of: Robot) -> None:
    joints = some(of, 1) * 0.9
    moved, rotation, origin = compute_jacobian(of, joints)
    step = 1e-6
    for k in range(len(of.joints)):
        other = joints.copy()
        other[0, k] += step
        turned, shifted = compute_flange(of, other)
        skew = (turned[0] @ rotation[0].T - np.eye(3)) / step
        slope = [*((shifted - origin)[0] / step), skew[2, 1], skew[0, 2], skew[1, 0]]
        assert moved[0, :, k] == pytest.approx(slope, abs=2e-3)


def test_home_keeps_all_limits() -> None:
    for of in list_robots():
        assert are_within_limits(of, of.home)


def test_the_rod_limits_two_axes_together() -> None:
    of = find_robot("IRB 2400")
    rows = [
        [0, 60, 0, 0, 0, 0],
        [0, 60, -5, 0, 0, 0],
        [0, 60, 66, 0, 0, 0],
        [0, -40, 27, 0, 0, 0],
        [181, 0, 0, 0, 0, 0],
    ]
    joints = np.radians(rows)
    assert are_within_limits(of, joints).tolist() == [True, False, False, False, False]
    # -5 - 60 is 5 beyond -60; 66 is 1 beyond the 65 of axis 3 itself; 27 + 40 is 2 beyond 65; 181 is 1 beyond 180.
    assert np.degrees(measure_excess(of, joints).max(axis=1)[1:]) == pytest.approx([5, 1, 2, 1])


def test_the_rods_limit_gives_the_reach_of_the_data_sheet() -> None:
    """IRB 2400-10: 1.55 m from axis 1 to the wrist centre, with axis 3 at its -60 deg against the upper arm."""
    of = find_robot("IRB 2400")
    farthest = 0.0
    for tilt in np.radians(np.arange(80, 101)):
        joints = np.array([[0, tilt, tilt - math.radians(60), 0, 0, 0]])
        farthest = max(farthest, compute_link_frames(of, joints)[1][0, 5, 0])
    assert farthest == pytest.approx(1550, abs=1)


def test_denso_figure_of_a_listing() -> None:
    """P(350, 0, 450, 180, 0, 180, 5) is lefty, above, non-flip; tool down at y = 0 leaves J1, J4 and J6 at 0."""
    for name in ("VS-060", "VS-6556"):
        of = find_robot(name)
        down = rotation_from_fixed_xyz(math.pi, 0, math.pi)
        solutions = compute_solutions(of, down[None], np.array([[350.0, 0, 450]]))[0]
        figures = denso_figure(of, solutions)
        own = solutions[(figures.values == 5) & are_within_limits(of, solutions)]
        assert len(own) == 1
        assert np.degrees(own[0])[[0, 3, 5]] == pytest.approx([0, 0, 0], abs=1e-6)
        assert own[0][4] > 0


def test_denso_figure_counts_in_bits() -> None:
    of = find_robot("VS-060")
    rows = [
        ([0, 30, 60, 0, 30, 0], 5), ([0, 30, 60, 0, -30, 0], 1), ([0, 90, -60, 0, 30, 0], 7),
        ([0, 30, 60, 0, 30, 190], 13), ([0, 30, 60, -180, 30, 0], 21), ([0, 30, 60, 180, 30, 0], 5),
        ([0, -30, -60, 0, 30, 0], ANY_FIGURE),
    ]  # fmt: skip
    figures = denso_figure(of, np.radians([row for row, _ in rows]))
    assert figures.values.tolist() == [figure for _, figure in rows]
    assert figures.sure.tolist() == [True] * 6 + [False]


def test_cobotta_keeps_the_figure_it_has() -> None:
    figures = denso_figure(find_robot("COBOTTA"), find_robot("COBOTTA").home[None])
    assert (figures.values.tolist(), figures.sure.tolist()) == ([ANY_FIGURE], [False])


def test_quarter_turns_of_abb() -> None:
    of = find_robot("IRB 120")
    rows = [
        [0, 0, 0, 0, 30, 0],
        [-1e-9, 0, 0, 90, 30, 89.9999],
        [-91, 0, 0, -90, -30, 180],
        [100, 0, 0, -150, 0, -361],
    ]
    data = abb_confdata(of, np.radians(rows))
    assert data.values[:, :3].tolist() == [[0, 0, 0], [0, 1, 0], [-2, -1, 2], [1, -2, -5]]
    assert (data.values[:, 3] & 1).tolist() == [0, 0, 1, 0]


def test_cfx_is_what_it_is_seen_to_be() -> None:
    """4: the wrist centre behind axis 1; 2: behind the line of the lower arm; both from the frames of the links."""
    for name in ("IRB 120", "IRB 1200"):
        of = find_robot(name)
        joints = some(of, 500)
        rotations, origins = compute_link_frames(of, joints)
        wrist, ahead = origins[:, 5], rotations[:, 1, :, 0]
        behind = ((wrist - origins[:, 1]) * ahead).sum(axis=1) < 0
        lower, fore = origins[:, 3] - origins[:, 2], wrist - origins[:, 3]
        back = (np.cross(lower, fore) * rotations[:, 1, :, 1]).sum(axis=1) < 0
        expected = 4 * behind + 2 * back + (joints[:, 4] < 0)
        data = abb_confdata(of, joints)
        assert data.values[:, 3].tolist() == expected.tolist()
        assert len(set(expected.tolist())) == 8
        assert data.sure.all()


def test_an_arm_with_a_rod_has_no_cfx() -> None:
    of = find_robot("IRB 2400")
    data = abb_confdata(of, np.radians([[0, 0, 0, 0, -30, 0], [0, -90, 0, 0, 30, 0]]))
    assert data.values.tolist() == [[0, 0, 0, 0], [0, 0, 0, 0]]
    # The second: 705 back, 755 + 100 ahead, still in front; further back the wrist is behind axis 1.
    assert data.sure.tolist() == [True, True]
    assert not abb_confdata(of, np.radians([[0, -95, -100, 0, 30, 0]])).sure.any()


def test_switches_of_vplus() -> None:
    viper = vplus_switches(
        find_robot("Viper s650"), np.radians([[0, -90, 180, 0, 0, 0], [0, -45, 60, 0, -30, 200]])
    )
    assert viper.words == (
        ("LEFTY", "ABOVE", "NOFLIP", "SINGLE"),
        ("LEFTY", "BELOW", "FLIP", "MULTIPLE"),
    )
    assert viper.sure.all()
    back = vplus_switches(find_robot("Viper s650"), np.radians([[0, -150, 90, 0, 30, 0]]))
    assert (back.words[0][0], back.sure.tolist()) == ("RIGHTY", [False])
    cobra = find_robot("Cobra s600")
    scara = vplus_switches(cobra, np.array([[0, 45, 0, 0], [0, -45, 0, 185]]) / units(cobra))
    assert scara.words == (("RIGHTY", "SINGLE"), ("LEFTY", "MULTIPLE"))


def test_a_posture_that_a_robot_has_not_is_refused() -> None:
    for name in ("COBOTTA", "mill", "Cobra s600"):
        of = find_robot(name)
        with pytest.raises(JobError, match="has no confdata"):
            abb_confdata(of, of.home[None])
    with pytest.raises(JobError, match=r"has no V\+ switches"):
        vplus_switches(find_robot("mill"), find_robot("mill").home[None])


def test_a_robot_is_a_value() -> None:
    of = find_robot("IRB 120")
    with pytest.raises(AttributeError):
        of.name = "other"  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        of.limits[0, 0] = 0
    assert replace(of, name="other").arm is of.arm
