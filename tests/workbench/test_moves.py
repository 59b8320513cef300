"""Seams and the order of single contours, as the page changes them: in the job's own words, and built as they say."""

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


def made(session: Session) -> Built:
    ask = BuildRequest(
        1, session.inputs, session.post, session.job_file, session.text, session.output
    )
    outcome = run_request(ask, ignore_stages, list_rows)
    assert isinstance(outcome, Built), outcome
    return outcome


def worked(built: Built) -> list[str]:
    return [run.contours[0] for run in built.summary.runs]


def test_a_path_that_is_moved_runs_there_and_what_comes_before_it_stays(
    session: Session, tmp_path: Path
) -> None:
    first = made(session)
    before = worked(first)
    assert before[-1] == "c1"  # the outline comes last
    session = add_step(session, move_path(session.tables, first.summary, 2, 0))
    assert session.tables["tour"] == {"order": [before[2]]}
    second = made(session)
    assert worked(second)[0] == before[2]
    assert [run.ordered for run in second.summary.runs] == [True, False, False, False]
    now = worked(second)
    session = add_step(session, move_path(session.tables, second.summary, 0, 1))
    # Down by one: both are named, as they stand now.
    assert session.tables["tour"] == {"order": [now[1], now[0]]}
    # A hole that is moved up keeps what was named below it.
    third = made(session)
    assert move_path(session.tables, third.summary, 1, 0)["tour"] == {"order": [now[0], now[1]]}
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


def test_a_seam_that_is_moved_is_one_point_of_the_job_and_can_be_given_up(session: Session) -> None:
    first = made(session)
    path = worked(first).index("c1")
    begun = first.summary.runs[path].seam
    assert begun is not None
    assert first.summary.runs[path].point is None
    corner = (begun[0] + 7.12345, begun[1])
    session = add_step(session, move_seam(session.tables, first.summary, path, corner))
    seams = session.tables["tour"]["seams"]
    assert seams == [[round(corner[0], 3), round(corner[1], 3)]]
    second = made(session)
    run = second.summary.runs[worked(second).index("c1")]
    assert run.point == tuple(seams[0])
    assert run.seam is not None
    # Moved on: the same point of the job, not one more.
    again = move_seam(
        session.tables, second.summary, worked(second).index("c1"), (run.seam[0] + 3, run.seam[1])
    )
    assert len(again["tour"]["seams"]) == 1
    assert again["tour"]["seams"] != seams
    assert "tour" not in move_seam(session.tables, second.summary, worked(second).index("c1"), None)


def test_leads_do_not_move_the_seam_that_is_shown(session: Session) -> None:
    plain = made(session)
    with_leads = add_step(
        session, {**session.tables, "operation": {"lead_in": 2, "lead_out": 2, "overlap": 1}}
    )
    path = worked(plain).index("c1")
    seam = plain.summary.runs[path].seam
    assert seam is not None
    with_leads = add_step(with_leads, move_seam(with_leads.tables, plain.summary, path, seam[:2]))
    led = made(with_leads)
    run = led.summary.runs[worked(led).index("c1")]
    assert run.seam == pytest.approx(seam, abs=2e-3)


def runs(*rows: int) -> tuple[PathSummary, ...]:
    return tuple(PathSummary((f"c{k}",), row, (float(k), 0.0, 0.0)) for k, row in enumerate(rows))


SHARED = (
    PathSummary(("c1",), 0, (5.0, 0.0, 0.0), (5.0, 1.0)),
    PathSummary(("c1",), 1, (5.0, 0.5, 0.0), (5.0, 1.0)),
    PathSummary(("c2",), 1, None),
)


@pytest.mark.parametrize(
    ("looked", "path", "to", "order"),
    [
        (InputSummary("drawing", runs=runs(0, 0, 1, 1)), 1, 0, ["c1"]),
        (InputSummary("drawing", runs=runs(0, 0, 1, 1)), 3, 2, ["c3"]),
        (InputSummary("drawing", runs=runs(-1, -1, -1, -1)), 0, 2, ["c1", "c2", "c0"]),
        # What other operations have named stays, in the order in which they run.
        (
            InputSummary("drawing", runs=(replace(runs(0)[0], ordered=True), *runs(0, 1, 1)[1:])),
            2,
            1,
            ["c0", "c2"],
        ),
        (
            InputSummary("drawing", runs=(*runs(0, 0), replace(runs(1, 1, 1)[2], ordered=True))),
            1,
            0,
            ["c1", "c2"],
        ),
    ],
)
def test_an_order_is_within_an_operation(
    looked: InputSummary, path: int, to: int, order: list[str]
) -> None:
    assert move_path({}, looked, path, to) == {"tour": {"order": order}}


def test_a_point_of_a_contour_stays_for_the_other_paths_along_it() -> None:
    tables: dict[str, Any] = {"tour": {"seams": [[9, 9], [5, 1]]}}
    looked = InputSummary("drawing", runs=SHARED)
    assert move_seam(tables, looked, 0, (7.0, 0.0))["tour"]["seams"] == [[9, 9], [5, 1], [7.0, 0.0]]
    # Two paths in one place have one seam.
    together = InputSummary("drawing", runs=(SHARED[0], replace(SHARED[1], seam=SHARED[0].seam)))
    assert move_seam(tables, together, 0, (7.0, 0.0))["tour"]["seams"] == [[9, 9], [7.0, 0.0]]
    assert move_seam(tables, looked, 0, None)["tour"]["seams"] == [[9, 9]]


@pytest.mark.parametrize(
    ("looked", "said"),
    [
        (InputSummary("solid", runs=runs(0, 0)), "only paths of drawings and pictures"),
        (InputSummary("program", runs=runs(0, 0)), "only paths of drawings and pictures"),
        (InputSummary("drawing", runs=runs(0)), "older program"),
        (InputSummary("drawing", runs=runs(0, 1)), "another operation"),
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
def test_what_has_no_words_is_refused(looked: InputSummary, said: str) -> None:
    with pytest.raises(JobError, match=said):
        move_seam({}, looked, 0, (1.0, 1.0)) if said == "is not closed" else move_path(
            {}, looked, 0, 1
        )
