"""Seams and the order of contours that the page changes: settings of the job, and their builds."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from camgen.cli import main
from camgen.cli.build import list_rows
from camgen.model.errors import JobError
from camgen.plan import ignore_stages
from camgen.workbench.choose import move_path, move_seam
from camgen.workbench.perform import BuildRequest, Built, InputSummary, PathSummary, run_request
from camgen.workbench.session import Session, add_step, open_session

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


@pytest.fixture
def session(tmp_path: Path) -> Session:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    return open_session(
        [tmp_path / "part.dxf"], None, ["tool.diameter=4"], "gcode", tmp_path, ["gcode"]
    )


def build_session(session: Session) -> Built:
    """The program of a session; the build must not fail."""
    request = BuildRequest(
        1, session.inputs, session.post, session.job_file, session.text, session.output
    )
    outcome = run_request(request, ignore_stages, list_rows)
    assert isinstance(outcome, Built), outcome
    return outcome


def list_contours(built: Built) -> list[str]:
    """The first contour of each path, in the order of the program."""
    return [run.contours[0] for run in built.summary.runs]


def test_a_moved_path_runs_at_its_new_place_and_the_paths_before_it_stay(
    session: Session, tmp_path: Path
) -> None:
    first = build_session(session)
    first_order = list_contours(first)
    assert first_order[-1] == "c1"  # the outline comes last
    session = add_step(session, move_path(session.tables, first.summary, 2, 0))
    assert session.tables["tour"] == {"order": [first_order[2]]}
    second = build_session(session)
    assert list_contours(second)[0] == first_order[2]
    assert [run.ordered for run in second.summary.runs] == [True, False, False, False]
    order = list_contours(second)
    session = add_step(session, move_path(session.tables, second.summary, 0, 1))
    # One place down: both contours are named in their new order.
    assert session.tables["tour"] == {"order": [order[1], order[0]]}
    # A hole that is moved up keeps the contours named below it.
    third = build_session(session)
    assert move_path(session.tables, third.summary, 1, 0)["tour"] == {"order": [order[0], order[1]]}
    # The file that is saved is the job of the command line.
    session.job_file.write_text(session.text)
    (tmp_path / "line").mkdir()
    assert (
        main(
            ["build", str(session.inputs[0]), "--post", "gcode", "-o", str(tmp_path / "line"), "-q"]
        )
        == 0
    )
    assert [(tmp_path / "line" / path.name).read_bytes() for path, _ in third.programs] == [
        data for _, data in third.programs
    ]


def test_a_moved_seam_is_one_point_of_the_job_and_can_be_removed(session: Session) -> None:
    first = build_session(session)
    path = list_contours(first).index("c1")
    seam = first.summary.runs[path].seam
    assert seam is not None
    assert first.summary.runs[path].point is None
    corner = (seam[0] + 7.12345, seam[1])
    session = add_step(session, move_seam(session.tables, first.summary, path, corner))
    seams = session.tables["tour"]["seams"]
    assert seams == [[round(corner[0], 3), round(corner[1], 3)]]
    second = build_session(session)
    run = second.summary.runs[list_contours(second).index("c1")]
    assert run.point == tuple(seams[0])
    assert run.seam is not None
    # A second move changes the point of the job and adds none.
    moved_tables = move_seam(
        session.tables,
        second.summary,
        list_contours(second).index("c1"),
        (run.seam[0] + 3, run.seam[1]),
    )
    assert len(moved_tables["tour"]["seams"]) == 1
    assert moved_tables["tour"]["seams"] != seams
    assert "tour" not in move_seam(
        session.tables, second.summary, list_contours(second).index("c1"), None
    )


def test_leads_do_not_move_the_seam_that_is_shown(session: Session) -> None:
    plain = build_session(session)
    with_leads = add_step(
        session, {**session.tables, "operation": {"lead_in": 2, "lead_out": 2, "overlap": 1}}
    )
    path = list_contours(plain).index("c1")
    seam = plain.summary.runs[path].seam
    assert seam is not None
    with_leads = add_step(with_leads, move_seam(with_leads.tables, plain.summary, path, seam[:2]))
    result = build_session(with_leads)
    run = result.summary.runs[list_contours(result).index("c1")]
    assert run.seam == pytest.approx(seam, abs=2e-3)


def make_runs(*rows: int) -> tuple[PathSummary, ...]:
    """One path for each row: the index of its operation, -1 for none."""
    return tuple(PathSummary((f"c{k}",), row, (float(k), 0.0, 0.0)) for k, row in enumerate(rows))


SHARED = (
    PathSummary(("c1",), 0, (5.0, 0.0, 0.0), (5.0, 1.0)),
    PathSummary(("c1",), 1, (5.0, 0.5, 0.0), (5.0, 1.0)),
    PathSummary(("c2",), 1, None),
)


@pytest.mark.parametrize(
    ("summary", "path", "to", "order"),
    [
        (InputSummary("drawing", runs=make_runs(0, 0, 1, 1)), 1, 0, ["c1"]),
        (InputSummary("drawing", runs=make_runs(0, 0, 1, 1)), 3, 2, ["c3"]),
        (InputSummary("drawing", runs=make_runs(-1, -1, -1, -1)), 0, 2, ["c1", "c2", "c0"]),
        # Contours of other operations stay in the order of their paths.
        (
            InputSummary(
                "drawing", runs=(replace(make_runs(0)[0], ordered=True), *make_runs(0, 1, 1)[1:])
            ),
            2,
            1,
            ["c0", "c2"],
        ),
        (
            InputSummary(
                "drawing", runs=(*make_runs(0, 0), replace(make_runs(1, 1, 1)[2], ordered=True))
            ),
            1,
            0,
            ["c1", "c2"],
        ),
    ],
)
def test_paths_are_ordered_within_their_operation(
    summary: InputSummary, path: int, to: int, order: list[str]
) -> None:
    assert move_path({}, summary, path, to) == {"tour": {"order": order}}


def test_a_seam_that_other_paths_share_keeps_its_point() -> None:
    tables: dict[str, Any] = {"tour": {"seams": [[9, 9], [5, 1]]}}
    summary = InputSummary("drawing", runs=SHARED)
    assert move_seam(tables, summary, 0, (7.0, 0.0))["tour"]["seams"] == [
        [9, 9],
        [5, 1],
        [7.0, 0.0],
    ]
    # Two paths with seams at one point move together.
    both = InputSummary("drawing", runs=(SHARED[0], replace(SHARED[1], seam=SHARED[0].seam)))
    assert move_seam(tables, both, 0, (7.0, 0.0))["tour"]["seams"] == [[9, 9], [7.0, 0.0]]
    assert move_seam(tables, summary, 0, None)["tour"]["seams"] == [[9, 9]]


@pytest.mark.parametrize(
    ("summary", "message"),
    [
        (InputSummary("solid", runs=make_runs(0, 0)), "only paths of drawings and pictures"),
        (InputSummary("program", runs=make_runs(0, 0)), "only paths of drawings and pictures"),
        (InputSummary("drawing", runs=make_runs(0)), "older program"),
        (InputSummary("drawing", runs=make_runs(0, 1)), "another operation"),
        (
            InputSummary("drawing", runs=(PathSummary(("c1",), 0), PathSummary(("c2",), 1))),
            "is not closed",
        ),
        (
            InputSummary(
                "drawing", runs=(PathSummary(("c1", "c2"), 0), PathSummary(("c2", "c1"), 0))
            ),
            "work on the same contours",
        ),
    ],
)
def test_a_change_that_no_setting_describes_is_refused(summary: InputSummary, message: str) -> None:
    with pytest.raises(JobError, match=message):
        move_seam({}, summary, 0, (1.0, 1.0)) if message == "is not closed" else move_path(
            {}, summary, 0, 1
        )
