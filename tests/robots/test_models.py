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
    "abb_irb120", "abb_irb1200_5_90", "abb_irb2000", "abb_irb2400_10", "adept_cobra_s600",
    "adept_viper_s650", "cnc_3axis", "denso_cobotta", "denso_vs060", "denso_vs6556", "denso_vs6577",
)  # fmt: skip


def draw_joint_values(robot: Robot, count: int, seed: int = 0) -> np.ndarray:
    """Joint values (count, J) within all limits."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (8 * count, len(robot.joints)))
    return values[are_within_limits(robot, values)][:count]


def display_units(robot: Robot) -> np.ndarray:
    """Factors (J,) from the units of camgen, rad and mm, to deg and mm."""
    return np.array([1.0 if joint.sliding else math.degrees(1) for joint in robot.joints])


def compute_pose(robot: Robot, *degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and origin (3,) of the flange for joint values in deg and mm."""
    rotations, origins = compute_flange(robot, np.array([degrees]) / display_units(robot))
    return rotations[0], origins[0]


def test_there_are_eleven_robots_of_four_kinds() -> None:
    kinds = {robot.name: robot.kind for robot in list_robots()}
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
def test_a_file_has_one_of_the_names_of_its_robot(file: str) -> None:
    """A robot is found by the name of its file, without reading the other files."""
    data = tomllib.loads((resources.files("camgen.robots") / "data" / file).read_text())
    stem = file.removesuffix(".toml")
    stems = []
    for name in (data["name"], *data["also"]):
        stems.append("".join(filter(str.isalnum, name.casefold())))
    assert stem in stems
    assert find_robot(stem).name == data["name"]


def test_the_most_similar_name_is_suggested_for_an_unknown_robot() -> None:
    with pytest.raises(
        JobError, match=r"^robot irb 2401: there is no such robot; nearest is IRB 2400; "
    ):
        find_robot("irb 2401")


@pytest.mark.parametrize("name", ARMS)
def test_the_flange_agrees_with_a_table_of_denavit_and_hartenberg(name: str) -> None:
    robot = find_robot(name)
    joints = draw_joint_values(robot, 50)
    rotations, origins = compute_flange(robot, joints)
    for row, degrees in enumerate(np.degrees(joints)):
        expected = by_hand(name, degrees)
        assert np.abs(origins[row] - expected[:3, 3]).max() < 1e-9
        assert np.abs(rotations[row] - expected[:3, :3]).max() < 1e-12


def test_the_flange_of_the_irb_120_at_zero_is_374_mm_ahead_at_630_mm() -> None:
    """270 + 290 + 70 mm up, 302 + 72 mm ahead; the flange has z ahead and x down.

    That is the quaternion 0.7071, 0, 0.7071, 0.
    """
    rotation, origin = compute_pose(find_robot("IRB 120"), 0, 0, 0, 0, 0, 0)
    assert origin == pytest.approx([374, 0, 630], abs=1e-9)
    assert rotation == pytest.approx(np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]), abs=1e-12)


def test_the_parallel_rod_keeps_the_forearm_level() -> None:
    """With axis 2 of the IRB 2400 at 30 deg and axis 3 at 0, only the upper arm has moved."""
    rotation, origin = compute_pose(find_robot("IRB 2400"), 0, 30, 0, 0, 0, 0)
    assert origin == pytest.approx(
        [100 + 705 * 0.5 + 755 + 85, 0, 615 + 705 * math.sqrt(0.75) + 135], abs=1e-9
    )
    assert rotation[:, 2] == pytest.approx([1, 0, 0], abs=1e-12)


def test_the_cobotta_stretched_up_and_ahead_agrees_with_its_lengths() -> None:
    """180 + 165 - 345 + 522.5 + 42 mm up, 12 mm back, 20 - 20 - 44.5 mm to the side.

    J2 = 90 deg rotates all above 180 mm about y.
    """
    robot = find_robot("COBOTTA")
    assert compute_pose(robot, 0, 0, 0, 0, 0, 0)[1] == pytest.approx([-12, -44.5, 564.5], abs=1e-9)
    assert compute_pose(robot, 0, 90, 0, 0, 0, 0)[1] == pytest.approx([384.5, -44.5, 192], abs=1e-9)


def test_the_cobra_stretched_and_bent_and_lowered_agrees_with_its_lengths() -> None:
    robot = find_robot("Cobra s600")
    assert compute_pose(robot, 0, 0, 0, 0)[1] == pytest.approx([600, 0, 387], abs=1e-9)
    rotation, origin = compute_pose(robot, 30, 60, 100, 0)
    assert origin == pytest.approx([325 * math.sqrt(0.75), 325 * 0.5 + 275, 287], abs=1e-9)
    assert rotation == pytest.approx(np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), abs=1e-12)
    # J4 rotates clockwise seen from above, so that tool x goes from +y towards +x.
    assert compute_pose(robot, 30, 60, 100, 30)[0][:, 0] == pytest.approx(
        [0.5, math.sqrt(0.75), 0], abs=1e-12
    )


def test_the_viper_is_the_vs_6556_with_other_zeros() -> None:
    viper, denso = find_robot("Viper s650"), find_robot("VS-6556")
    joints = draw_joint_values(denso, 20)
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
def test_models_agree_with_the_shared_descriptions(stem: str) -> None:
    data, robot = shared_robot(stem), find_robot(stem)
    order = (
        [1, 0, 2] if stem == "cnc_3axis" else range(len(robot.joints))
    )  # the description has Y, X, Z
    unit = display_units(robot)
    joint_rows = [data["joint"][k] for k in order]
    assert robot.limits * unit[:, None] == pytest.approx(
        np.array([[row["min"], row["max"]] for row in joint_rows])
    )
    assert robot.speeds * unit == pytest.approx([row["max_speed"] for row in joint_rows])
    assert robot.home * unit == pytest.approx(np.array(data["home"]["q"])[list(order)])
    assert [list(pair) for pair in robot.touching] == data["collision"]["ignore_pairs"]
    boxes, described = [], []
    for link in robot.links:
        boxes.append([[*box.link_from_box.origin, *box.half] for box in link.boxes])
    for link in data["link"]:
        described.append([[*box["center_mm"], *box["half_mm"]] for box in link["boxes"]])
    assert boxes == described
    joints = draw_joint_values(robot, 10)
    rotations, origins = compute_link_frames(robot, joints)
    tips = compute_flange(robot, joints)
    for row, values in enumerate(joints * unit):
        expected = shared_frames(data, values[list(order)])
        last = len(expected) - 2
        links = range(last, last + 1) if stem == "cnc_3axis" else range(last + 1)
        for k in links:
            assert np.abs(origins[row, k] - expected[k][:3, 3]).max() < 1e-9
            assert np.abs(rotations[row, k] - expected[k][:3, :3]).max() < 1e-12
        assert np.abs(tips[1][row] - expected[-1][:3, 3]).max() < 1e-9
        assert np.abs(tips[0][row] - expected[-1][:3, :3]).max() < 1e-12


@pytest.mark.parametrize("robot", list_robots(), ids=lambda robot: robot.name)
def test_the_jacobian_is_the_slope_of_the_flange(robot: Robot) -> None:
    joints = draw_joint_values(robot, 1) * 0.9
    jacobian, rotation, origin = compute_jacobian(robot, joints)
    step = 1e-6
    for k in range(len(robot.joints)):
        other = joints.copy()
        other[0, k] += step
        turned_rotations, shifted = compute_flange(robot, other)
        skew = (turned_rotations[0] @ rotation[0].T - np.eye(3)) / step
        slope = [*((shifted - origin)[0] / step), skew[2, 1], skew[0, 2], skew[1, 0]]
        assert jacobian[0, :, k] == pytest.approx(slope, abs=2e-3)


def test_home_is_within_all_limits() -> None:
    for robot in list_robots():
        assert are_within_limits(robot, robot.home)


def test_the_parallel_rod_limits_axis_3_against_axis_2() -> None:
    robot = find_robot("IRB 2400")
    rows = [
        [0, 60, 0, 0, 0, 0],
        [0, 60, -5, 0, 0, 0],
        [0, 60, 66, 0, 0, 0],
        [0, -40, 27, 0, 0, 0],
        [181, 0, 0, 0, 0, 0],
    ]
    joints = np.radians(rows)
    assert are_within_limits(robot, joints).tolist() == [True, False, False, False, False]
    # Axis 3 less axis 2 may be -60 to 65 deg: -5 - 60 is 5 beyond, and 27 + 40 is 2 beyond.
    # Axis 3 itself may be 65 deg, axis 1 180 deg: 66 and 181 are 1 beyond.
    assert np.degrees(measure_excess(robot, joints).max(axis=1)[1:]) == pytest.approx([5, 1, 2, 1])


def test_the_limit_of_the_rod_gives_the_reach_of_the_data_sheet() -> None:
    """IRB 2400-10: the wrist centre is up to 1.55 m from axis 1.

    There axis 3 is at its limit of -60 deg against the upper arm.
    """
    robot = find_robot("IRB 2400")
    farthest = 0.0
    for tilt in np.radians(np.arange(80, 101)):
        joints = np.array([[0, tilt, tilt - math.radians(60), 0, 0, 0]])
        farthest = max(farthest, compute_link_frames(robot, joints)[1][0, 5, 0])
    assert farthest == pytest.approx(1550, abs=1)


def test_the_denso_figure_of_a_listing_is_found() -> None:
    """P(350, 0, 450, 180, 0, 180, 5) is lefty, above, non-flip.

    J1, J4 and J6 are 0, since the tool points down at y = 0.
    """
    for name in ("VS-060", "VS-6556"):
        robot = find_robot(name)
        down = rotation_from_fixed_xyz(math.pi, 0, math.pi)
        solutions = compute_solutions(robot, down[None], np.array([[350.0, 0, 450]]))[0]
        figures = denso_figure(robot, solutions)
        with_figure_5 = solutions[(figures.values == 5) & are_within_limits(robot, solutions)]
        assert len(with_figure_5) == 1
        assert np.degrees(with_figure_5[0])[[0, 3, 5]] == pytest.approx([0, 0, 0], abs=1e-6)
        assert with_figure_5[0][4] > 0


def test_each_property_is_a_bit_of_the_denso_figure() -> None:
    robot = find_robot("VS-060")
    rows = [
        ([0, 30, 60, 0, 30, 0], 5), ([0, 30, 60, 0, -30, 0], 1), ([0, 90, -60, 0, 30, 0], 7),
        ([0, 30, 60, 0, 30, 190], 13), ([0, 30, 60, -180, 30, 0], 21), ([0, 30, 60, 180, 30, 0], 5),
        ([0, -30, -60, 0, 30, 0], ANY_FIGURE),
    ]  # fmt: skip
    figures = denso_figure(robot, np.radians([row for row, _ in rows]))
    assert figures.values.tolist() == [figure for _, figure in rows]
    assert figures.sure.tolist() == [True] * 6 + [False]


def test_the_figure_of_the_cobotta_is_left_open() -> None:
    figures = denso_figure(find_robot("COBOTTA"), find_robot("COBOTTA").home[None])
    assert (figures.values.tolist(), figures.sure.tolist()) == ([ANY_FIGURE], [False])


def test_abb_confdata_counts_quarter_turns() -> None:
    robot = find_robot("IRB 120")
    rows = [
        [0, 0, 0, 0, 30, 0],
        [-1e-9, 0, 0, 90, 30, 89.9999],
        [-91, 0, 0, -90, -30, 180],
        [100, 0, 0, -150, 0, -361],
    ]
    data = abb_confdata(robot, np.radians(rows))
    assert data.values[:, :3].tolist() == [[0, 0, 0], [0, 1, 0], [-2, -1, 2], [1, -2, -5]]
    assert (data.values[:, 3] & 1).tolist() == [0, 0, 1, 0]


def test_cfx_agrees_with_the_positions_of_the_links() -> None:
    """A wrist centre behind axis 1 counts 4, one beyond the line of the lower arm 2.

    Here both are computed from the frames of the links. A negative axis 5 counts 1.
    """
    for name in ("IRB 120", "IRB 1200"):
        robot = find_robot(name)
        joints = draw_joint_values(robot, 500)
        rotations, origins = compute_link_frames(robot, joints)
        wrist, forward = origins[:, 5], rotations[:, 1, :, 0]
        is_behind_axis_1 = ((wrist - origins[:, 1]) * forward).sum(axis=1) < 0
        lower_arm, forearm = origins[:, 3] - origins[:, 2], wrist - origins[:, 3]
        is_behind_lower_arm = (np.cross(lower_arm, forearm) * rotations[:, 1, :, 1]).sum(axis=1) < 0
        expected = 4 * is_behind_axis_1 + 2 * is_behind_lower_arm + (joints[:, 4] < 0)
        data = abb_confdata(robot, joints)
        assert data.values[:, 3].tolist() == expected.tolist()
        assert len(set(expected.tolist())) == 8
        assert data.sure.all()


def test_cfx_of_an_arm_with_a_parallel_rod_is_0_or_unsure() -> None:
    robot = find_robot("IRB 2400")
    data = abb_confdata(robot, np.radians([[0, 0, 0, 0, -30, 0], [0, -90, 0, 0, 30, 0]]))
    assert data.values.tolist() == [[0, 0, 0, 0], [0, 0, 0, 0]]
    # In the second row the wrist is 705 mm back and 755 + 100 mm ahead, still in front of axis 1.
    # In the row below it is behind axis 1.
    assert data.sure.tolist() == [True, True]
    assert not abb_confdata(robot, np.radians([[0, -95, -100, 0, 30, 0]])).sure.any()


def test_vplus_switches_name_the_posture() -> None:
    viper = vplus_switches(
        find_robot("Viper s650"), np.radians([[0, -90, 180, 0, 0, 0], [0, -45, 60, 0, -30, 200]])
    )
    assert viper.values.tolist() == [
        ["LEFTY", "ABOVE", "NOFLIP", "SINGLE"],
        ["LEFTY", "BELOW", "FLIP", "MULTIPLE"],
    ]
    assert viper.sure.all()
    bent_back = vplus_switches(find_robot("Viper s650"), np.radians([[0, -150, 90, 0, 30, 0]]))
    assert (bent_back.values[0, 0], bent_back.sure.tolist()) == ("RIGHTY", [False])
    cobra = find_robot("Cobra s600")
    scara = vplus_switches(
        cobra, np.array([[0, 45, 0, 0], [0, -45, 0, 185]]) / display_units(cobra)
    )
    assert scara.values.tolist() == [["RIGHTY", "SINGLE"], ["LEFTY", "MULTIPLE"]]


def test_a_robot_without_a_notation_for_postures_is_refused() -> None:
    for name in ("COBOTTA", "mill", "Cobra s600"):
        robot = find_robot(name)
        with pytest.raises(JobError, match="has no confdata"):
            abb_confdata(robot, robot.home[None])
    with pytest.raises(JobError, match=r"has no V\+ switches"):
        vplus_switches(find_robot("mill"), find_robot("mill").home[None])


def test_a_robot_cannot_be_changed_in_place() -> None:
    robot = find_robot("IRB 120")
    with pytest.raises(AttributeError):
        robot.name = "other"  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        robot.limits[0, 0] = 0
    assert replace(robot, name="other").arm is robot.arm
