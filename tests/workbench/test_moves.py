"""Seams and the order of single contours, as the page changes them: in the job's own words, and built as they say."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from camgen.cli import main
from camgen.cli.build import rows
from camgen.model.errors import JobError
from camgen.plan import ignore_stages
from camgen.workbench.choose import move_path, move_seam
from camgen.workbench.perform import Ask, Built, Looked, Run, perform
from camgen.workbench.session import Session, open_session, step

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


@pytest.fixture
def session(tmp_path: Path) -> Session:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    return open_session(
        [tmp_path / "part.dxf"], None, ["tool.diameter=4"], "gcode", tmp_path, ["gcode"]
    )


def made(session: Session) -> Built:
    ask = Ask(1, session.inputs, session.post, session.job_file, session.text, session.output)
    outcome = perform(ask, ignore_stages, rows)
    assert isinstance(outcome, Built), outcome
    return outcome


def worked(built: Built) -> list[str]:
    return [run.contours[0] for run in built.looked.runs]


def test_a_path_that_is_moved_runs_there_and_what_comes_before_it_stays(
    session: Session, tmp_path: Path
) -> None:
    first = made(session)
    before = worked(first)
    assert before[-1] == "c1"  # the outline comes last
    session = step(session, move_path(session.tables, first.looked, 2, 0))
    assert session.tables["tour"] == {"order": [before[2]]}
    second = made(session)
    assert worked(second)[0] == before[2]
    assert [run.ordered for run in second.looked.runs] == [True, False, False, False]
    now = worked(second)
    session = step(session, move_path(session.tables, second.looked, 0, 1))
    # Down by one: both are named, as they stand now.
    assert session.tables["tour"] == {"order": [now[1], now[0]]}
    # A hole that is moved up keeps what was named below it.
    third = made(session)
    assert move_path(session.tables, third.looked, 1, 0)["tour"] == {"order": [now[0], now[1]]}
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
    begun = first.looked.runs[path].seam
    assert begun is not None
    assert first.looked.runs[path].point is None
    corner = (begun[0] + 7.12345, begun[1])
    session = step(session, move_seam(session.tables, first.looked, path, corner))
    seams = session.tables["tour"]["seams"]
    assert seams == [[round(corner[0], 3), round(corner[1], 3)]]
    second = made(session)
    run = second.looked.runs[worked(second).index("c1")]
    assert run.point == tuple(seams[0])
    assert run.seam is not None
    # Moved on: the same point of the job, not one more.
    again = move_seam(
        session.tables, second.looked, worked(second).index("c1"), (run.seam[0] + 3, run.seam[1])
    )
    assert len(again["tour"]["seams"]) == 1
    assert again["tour"]["seams"] != seams
    assert "tour" not in move_seam(session.tables, second.looked, worked(second).index("c1"), None)


def test_leads_do_not_move_the_seam_that_is_shown(session: Session) -> None:
    plain = made(session)
    with_leads = step(
        session, {**session.tables, "operation": {"lead_in": 2, "lead_out": 2, "overlap": 1}}
    )
    path = worked(plain).index("c1")
    seam = plain.looked.runs[path].seam
    assert seam is not None
    with_leads = step(with_leads, move_seam(with_leads.tables, plain.looked, path, seam[:2]))
    led = made(with_leads)
    run = led.looked.runs[worked(led).index("c1")]
    assert run.seam == pytest.approx(seam, abs=2e-3)


def runs(*rows: int) -> tuple[Run, ...]:
    return tuple(Run((f"c{k}",), row, (float(k), 0.0, 0.0)) for k, row in enumerate(rows))


SHARED = (
    Run(("c1",), 0, (5.0, 0.0, 0.0), (5.0, 1.0)),
    Run(("c1",), 1, (5.0, 0.5, 0.0), (5.0, 1.0)),
    Run(("c2",), 1, None),
)


@pytest.mark.parametrize(
    ("looked", "path", "to", "order"),
    [
        (Looked("drawing", runs=runs(0, 0, 1, 1)), 1, 0, ["c1"]),
        (Looked("drawing", runs=runs(0, 0, 1, 1)), 3, 2, ["c3"]),
        (Looked("drawing", runs=runs(-1, -1, -1, -1)), 0, 2, ["c1", "c2", "c0"]),
        # What other operations have named stays, in the order in which they run.
        (
            Looked("drawing", runs=(replace(runs(0)[0], ordered=True), *runs(0, 1, 1)[1:])),
            2,
            1,
            ["c0", "c2"],
        ),
        (
            Looked("drawing", runs=(*runs(0, 0), replace(runs(1, 1, 1)[2], ordered=True))),
            1,
            0,
            ["c1", "c2"],
        ),
    ],
)
def test_an_order_is_within_an_operation(
    looked: Looked, path: int, to: int, order: list[str]
) -> None:
    assert move_path({}, looked, path, to) == {"tour": {"order": order}}


def test_a_point_of_a_contour_stays_for_the_other_paths_along_it() -> None:
    tables: dict[str, Any] = {"tour": {"seams": [[9, 9], [5, 1]]}}
    looked = Looked("drawing", runs=SHARED)
    assert move_seam(tables, looked, 0, (7.0, 0.0))["tour"]["seams"] == [[9, 9], [5, 1], [7.0, 0.0]]
    # Two paths in one place have one seam.
    together = Looked("drawing", runs=(SHARED[0], replace(SHARED[1], seam=SHARED[0].seam)))
    assert move_seam(tables, together, 0, (7.0, 0.0))["tour"]["seams"] == [[9, 9], [7.0, 0.0]]
    assert move_seam(tables, looked, 0, None)["tour"]["seams"] == [[9, 9]]


@pytest.mark.parametrize(
    ("looked", "said"),
    [
        (Looked("solid", runs=runs(0, 0)), "only paths of drawings and pictures"),
        (Looked("program", runs=runs(0, 0)), "only paths of drawings and pictures"),
        (Looked("drawing", runs=runs(0)), "older program"),
        (Looked("drawing", runs=runs(0, 1)), "another operation"),
        (Looked("drawing", runs=(Run(("c1",), 0), Run(("c2",), 1))), "is not closed"),
        (
            Looked("drawing", runs=(Run(("c1", "c2"), 0), Run(("c2", "c1"), 0))),
            "work on the same contours",
        ),
    ],
)
def test_what_has_no_words_is_refused(looked: Looked, said: str) -> None:
    with pytest.raises(JobError, match=said):
        move_seam({}, looked, 0, (1.0, 1.0)) if said == "is not closed" else move_path(
            {}, looked, 0, 1
        )
