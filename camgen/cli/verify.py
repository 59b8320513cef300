"""`camgen verify`: reads a program back, lists its findings, and compares it with a plan."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from msgspec.structs import replace

from camgen.batch.writing import check_targets, write_all
from camgen.check.report import Motions, sum_up
from camgen.cli.header import find_part, name_source, read_header
from camgen.cli.inputs import check_suffix, to_path
from camgen.cli.judge import (
    Row,
    add_harm,
    convert_findings,
    find_error,
    format_findings,
    format_time,
    list_as_data,
    list_rows,
    make_run_options,
    name_files,
    read_texts,
    recognise_language,
)
from camgen.cli.motion_file import MotionFile
from camgen.cli.motion_file import load as load_plan
from camgen.cli.proven import Proven
from camgen.cli.rebuild import STATES, Origin, compare_rebuilt, pick_program, read_state
from camgen.cli.say import Terminal, format_length, format_table
from camgen.lang.alternatives import format_alternatives, run_alternatives
from camgen.lang.coverage import format_coverage
from camgen.lang.programs import CERTAIN, LANGUAGES, Executed, Finding, Frames, Places
from camgen.lang.recorded import format_box
from camgen.lang.taught import OneFrameBody, as_far_as_known
from camgen.lower.steps import split_tools
from camgen.model.errors import CamgenError, InputError, JobError
from camgen.model.job import Job
from camgen.model.plugins import list_entries
from camgen.model.pose import Pose
from camgen.model.program import Columns, ToolChange
from camgen.model.text import counted, short, short_each
from camgen.post import Post
from camgen.post.contract import prepare_program
from camgen.post.limits import limit_tolerance
from camgen.post.plugins import (
    cell_of,
    dynamics_of,
    fill_tables,
    find_post,
    find_readback,
    make_post,
    states_rounding,
)
from camgen.post.verify import compare
from camgen.read import read
from camgen.read.files import Files
from camgen.read.job_file import find_job_file, load_job

if TYPE_CHECKING:
    from camgen.geometry.fixtures import Fixtures

#: Number of work objects whose extents are listed.
_MOST_WORKS = 8
_NAMES = {
    "MoveJ": "joint motion",
    "MoveL": "straight motion",
    "MoveC": "arc",
    "Output": "output",
    "Wait": "wait",
    "Force": "force change",
    "ToolChange": "tool change",
    "Stop": "stop",
}


class _Request(NamedTuple):
    """The request of the user.

    arguments: arguments of the command.
    paths: files of the program.
    texts: their contents by name.
    job: settings.
    drawing: drawing against which the program is proven, None without one.
    files: files that were read.
    origin: the origin of the program by its header, None if job or part is not beside it.
    states_job: whether the text has a header of camgen.
    """

    arguments: Namespace
    paths: Sequence[Path]
    texts: Mapping[str, str]
    job: Job
    drawing: Path | None
    files: Files
    origin: Origin | None = None
    states_job: bool = False


def run(arguments: Namespace, terminal: Terminal) -> int | None:
    """Print the sums and the findings of a program.

    Raises InputError for refused lines, VerifyError for a difference from the plan, and
    NoSafeProgram for dangerous lines and for cuts into the part that `--part` names.

    A program with a plan or a job is one of ours, and is judged as strictly as a build does. Any
    other is judged by its language. The header of ours names the post if its job and its part are
    unchanged.
    """
    if arguments.summary:
        from camgen.cli.verify_many import run as run_many  # noqa: PLC0415 (only for many programs)

        return run_many(arguments, terminal)
    if arguments.sarif:
        raise JobError("--sarif", "is for --summary", remedy="add --summary, or use --json")
    paths = list(map(Path, arguments.programs))
    for path in paths:
        if path.is_dir():
            raise InputError(str(path), "is a folder", remedy="add --summary, or name the files")
    files = Files()
    drawing = to_path(arguments.part)
    texts = read_texts(paths, files)
    header = read_header(texts)
    if drawing is not None and header is not None and header.is_located:
        raise JobError(
            "--part",
            "lies as drawn, and the program is for the place of the part in a photo",
            remedy="leave it out; camgen build has proven the program against the drawing at "
            "that place",
        )
    source = name_source(paths[0], header)
    named = find_job_file(arguments.job, None if arguments.plan else source)
    job = load_job(named or find_job_file(None, drawing), arguments.sets, files)
    ours = bool(arguments.plan or named or job.post)
    origin = None
    if ours and header and not arguments.post and not arguments.plan:
        origin = Origin(header, find_part(header, source, job, files), job, source.stem)
        arguments.post = header.post
    request = _Request(arguments, paths, texts, job, drawing, files, origin, header is not None)
    post = arguments.post
    if ours or (post and post not in [entry.name for entry in list_entries(LANGUAGES)]):
        _verify_own(request, terminal)
    else:
        _verify_third_party(request, terminal)
    return None


def _verify_third_party(request: _Request, terminal: Terminal) -> None:
    """Verify a third-party program by the rules of its language."""
    arguments, paths, texts, job, drawing, files, *_ = request
    place = Places(texts)
    language = recognise_language(arguments.post or "", texts)
    options = make_run_options(language, arguments, job, files)
    if arguments.report:
        check_suffix(
            arguments.report,
            (".html",),
            "the report of a program is a page",
            "give a name that ends in .html",
        )
        check_targets([Path(arguments.report)], [*paths, *map(Path, arguments.points)])
    terminal.stage("running")
    alternatives = run_alternatives(language, texts, options)
    executed = add_harm(alternatives.executed, texts)
    if len(texts) > 1:
        executed = name_files(executed, place)
    carried = as_far_as_known(executed)
    motions = sum_up(Columns(carried.body), carried.works)
    if carried.body is not executed.body:
        motions = replace(motions, counts=sum_up(Columns(executed.body)).counts)
    rows = [
        ("language", language.about),
        *_rows(motions, texts, executed.untimed),
        *_list_extents(motions, executed.frames),
        *list_rows(executed, place),
        *format_alternatives(alternatives),
        *format_coverage(executed.coverage, place.find),
        *(("told", f"{note.what} ({note.why})") for note in carried.notes),
    ]
    error = find_error(executed, paths[0], place)
    if arguments.report:
        _report(Path(arguments.report), request, executed, carried, rows, terminal)
    more = list(_UNEXAMINED)
    also = ""
    if error is not None and drawing is not None:
        more = _leave_unproven("the program has lines to correct first")
    elif error is None and executed.stopped is not None:
        more = _leave_unproven("the run does not come to the end")
    elif error is None:
        fixtures = _read_fixtures(language.name, job, files, drawing)
        post = _post_of(language.name)
        dynamics = post.dynamics() if language.name in _STATES_ZONES else None
        proven = Proven(executed, dynamics=dynamics, fixtures=fixtures, on_arm=_is_for_arm(post))
        more, also, error = _prove(request, proven, place, terminal)
    if arguments.json:
        terminal.data({"sums": motions, "told": rows + more, **convert_findings(executed, place)})
    else:
        terminal.out(format_table([*rows, *more]) + format_findings(executed, place) + also)
    if error is not None:
        raise error


def _verify_own(request: _Request, terminal: Terminal) -> None:
    """Verify a program of camgen strictly, against its plan if there is one.

    Against a plan an unusual line is a fault too.
    """
    from camgen.pipeline.rounding import limit_path_tolerance  # noqa: PLC0415 (only for our texts)

    arguments, paths, texts, job, drawing, files, origin, states_job = request
    _check_options(arguments)
    plan = load_plan(Path(arguments.plan), files) if arguments.plan else None
    options = (plan.options if plan else {}) | limit_path_tolerance(job, arguments.post).post
    post = make_post(find_post(arguments.post), options)
    place = Places(texts)
    tools = _list_tools(plan, job, post, paths[0])
    kinds = [{**options, **post.name_tool(*tool)} for tool in tools] or [options]
    terminal.stage("reading")
    executed = _read_back(arguments.post, post, kinds, texts)
    motions = sum_up(Columns(executed.body))
    state = read_state(texts)
    rows = [*_rows(motions, texts), ("digest", STATES[state])]
    listing = _format_findings(executed.findings, place)

    def print_report(more: Sequence[Row] = (), also: str = "") -> None:
        if arguments.json:
            faults = list_as_data(executed.findings, place)
            terminal.data({"sums": motions, "told": dict([*rows, *more]), "faults": faults})
        else:
            terminal.out(format_table([*rows, *more]) + listing + also)

    serious = [fault for fault in executed.findings if plan or fault.level in CERTAIN]
    if serious:
        print_report()
        first = serious[0]
        raise InputError(
            str(paths[0]),
            f"{counted(len(serious), 'fault')}, first: {first.what}",
            place(first.line),
            "correct the program",
        )
    if not executed.body:
        raise InputError(
            str(paths[0]),
            f"holds no instruction of {post.name}",
            remedy="name its own post with --post",
        )
    if plan:
        terminal.stage("comparing")
        rows += _compare_plan(plan, post, executed, paths[0])
    different = None
    if origin is not None:
        drawing = drawing or origin.part
        row, different = compare_rebuilt(paths[0], post, executed, origin, terminal, files)
        rows.append(row)
    fixtures = _read_fixtures(post.name, job, files, drawing)
    dynamics = dynamics_of(post, job) if states_rounding(post) else None
    proven = Proven(executed, post, dynamics, _is_for_arm(post), states_job, fixtures)
    more, also, error = _prove(request, proven, place, terminal)
    print_report(more, also)
    if error is not None:
        raise error
    if different is not None and state == "edited":
        raise different


def _compare_plan(plan: MotionFile, post: Post, executed: Executed, path: Path) -> list[Row]:
    """Rows on the comparison with a plan. Raises VerifyError for the first line that differs."""
    tolerance = limit_tolerance(post.tolerance(), plan.chord)
    prepared = prepare_program(post, pick_program(plan.program, post, path), plan.chord)
    equal = compare(prepared, executed, tolerance, post.list_verified(), str(path))
    instructions = counted(equal.instructions, "instruction")
    return [("plan", f"{instructions} equal"), ("deviation", f"{equal.max_mm:.6f} mm")]


def _list_tools(plan: MotionFile | None, job: Job, post: Post, path: Path) -> list[tuple[int, str]]:
    """Numbers and names of tools: the program is for one of them. Empty if it changes tools itself.

    The plan states the tool of a program by its name. A job leaves it open which of its tools a
    program is for.
    """
    if post.changes_tools or "tool" in (plan.options if plan else job.post):
        return []
    if plan is None:
        return list(dict.fromkeys((step.tool.number, step.tool.name) for step in job.operations))
    changes = plan.program.columns.list_kinds(ToolChange)
    names = [part.name for part in split_tools(plan.program)]
    tools = [(change.number, change.name) for change in changes]
    if len(changes) > 1 and path.stem in names:
        return [tools[names.index(path.stem)]]
    return tools[:1]


def _read_back(
    name: str, post: Post, kinds: Sequence[dict[str, object]], texts: Mapping[str, str]
) -> Executed:
    """The strict run of a text with the options that leave the fewest findings.

    kinds: options of `[post]` with which the text may have been written.
    """
    read = find_readback(name)
    runs = [read(texts, fill_tables(type(post), options)) for options in kinds]
    return min(runs, key=lambda executed: len(executed.findings))


def _check_options(arguments: Namespace) -> None:
    """Raise JobError without a post, and for options that a program of camgen has no use for."""
    if not arguments.post:
        raise JobError(
            "--post", "is not given", remedy="with a job or a plan the controller has to be named"
        )
    for name in ("assume", "points", "entry", "dialect", "report"):
        if getattr(arguments, name):
            raise JobError(
                f"--{name}",
                "is for programs that camgen did not plan",
                remedy="leave out the job and the plan, or this",
            )


def _prove(
    request: _Request,
    proven: Proven,
    place: Callable[[int], str],
    terminal: Terminal,
) -> tuple[list[Row], str, CamgenError | None]:
    """The proofs against the drawing and the fixtures of the job, as far as they are given: rows, a
    line for each fault, and the error of a refusal.
    """
    drawing = request.drawing
    if drawing is None and proven.fixtures is None:
        return list(_UNEXAMINED), "", None
    from camgen.cli.stock import check_fixtures, check_stock  # noqa: PLC0415 (shapely)
    from camgen.pipeline.motion import (  # noqa: PLC0415 (only for a drawing)
        compare_text,
        describe_controller,
    )

    terminal.stage("proving")
    if drawing is None:
        judged = check_fixtures(str(request.paths[0]), request.job, proven, place)
        rows = [*_UNEXAMINED[:2], *judged.rows, *_UNEXAMINED[2:]]
        return rows, judged.fault_lines, judged.error
    part = read(drawing, request.job, request.files)
    executed = proven.executed
    stock = check_stock(str(request.paths[0]), part, request.job, proven, place)
    controller = None
    if proven.post is not None:
        from camgen.pipeline.inputs import read_cell  # noqa: PLC0415 (only for texts of camgen)

        cell = read_cell(part, request.job, cell_of(proven.post, request.job), request.files)
        controller = describe_controller(proven.post, request.job, cell)
    motion = compare_text(part, request.job, executed.body, executed.lines, place, controller)
    return [("motion", motion), *stock.rows, *_UNEXAMINED[2:]], stock.fault_lines, stock.error


def _read_fixtures(post: str, job: Job, files: Files, drawing: Path | None) -> Fixtures | None:
    """The fixtures of the job, for a program of a machine without an arm; else None.

    drawing: drawing with the clamps of the job; None if it is not known.
    """
    if not job.cell.fixtures:
        return None
    from camgen.pipeline.inputs import read_cell  # noqa: PLC0415 (only for jobs with fixtures)

    drawn = read(drawing, job, files) if drawing and job.drawn_fixtures else None
    return read_cell(drawn, job, cell_of(_post_of(post), job), files).fixtures


def _is_for_arm(post: Post) -> bool:
    """Whether the controller of a post runs an arm: the home of a machine is a pose."""
    return not isinstance(post.cell().home, Pose)


def _post_of(language: str) -> Post:
    """The post that writes a language, with its defaults."""
    return make_post(find_post(language), {})


#: Languages that state how far each corner is rounded: RAPID has a zone for each motion. The
#: corners of other languages depend on settings that their texts do not hold.
_STATES_ZONES = frozenset({"rapid"})
#: Proofs that a text alone does not allow, with the reason.
_UNEXAMINED: list[Row] = [
    ("motion", "not proven: no drawing is given, --part names one"),
    ("stock", "not proven: no drawing is given, --part names one"),
    ("reach", "not proven: verify examines the text, camgen build the arm"),
    ("collision", "not proven: verify examines the text, camgen build the arm"),
]


def _leave_unproven(reason: str) -> list[Row]:
    """The rows of the proofs if the program is not compared with its drawing."""
    unproven = f"not proven: {reason}"
    return [("motion", unproven), ("stock", unproven), *_UNEXAMINED[2:]]


def _report(
    target: Path,
    request: _Request,
    executed: Executed,
    carried: OneFrameBody,
    rows: Sequence[Row],
    terminal: Terminal,
) -> None:
    """Write the page of a program. Raises JobError for a file that must not be replaced."""
    from camgen.preview.page import format_page  # noqa: PLC0415
    from camgen.preview.third_party import view_program  # noqa: PLC0415 (only for a page)

    terminal.stage("drawing")
    texts = request.texts
    view = view_program(", ".join(texts), texts, executed, carried, rows, Places(texts))
    write_all([(target, format_page(view).encode("utf-8"))], request.files.opened)


def _rows(motions: Motions, texts: Mapping[str, str], untimed: int = 0) -> list[Row]:
    lines = sum(text.count("\n") for text in texts.values())
    kinds = [counted(n, _NAMES[kind]) for kind, n in motions.counts.items() if n]
    rows = [
        ("program", f"{counted(lines, 'line')}: {', '.join(kinds) or 'no instruction'}"),
        ("straight", format_length(motions.straight)),
        ("arcs", format_length(motions.arc)),
        ("joint", f"{format_length(motions.joint)} between the ends"),
        ("time", format_time(motions.seconds, untimed)),
    ]
    if motions.speeds[1] > 0:
        speeds = " to ".join(dict.fromkeys(short_each(motions.speeds, 3)))
        rows.append(("speed", f"{speeds} mm/s"))
    if motions.extents and not motions.extents_by_work:
        rows.append(("extents", format_box(*motions.extents)))
    for name, values in motions.outputs.items():
        rows.append(("output", f"{name}: {', '.join(short_each(values, 3))}"))
    if motions.force:
        rows.append(("force", f"up to {short(motions.force, 3)} N"))
    return rows


def _list_extents(motions: Motions, frames: Sequence[Frames]) -> list[Row]:
    """The extents in each of several work objects whose poses are unknown."""
    rows = []
    for number, extents in motions.extents_by_work.items():
        frame = frames[number].work or "of the base"
        rows.append(("extents", f"{format_box(*extents)}, in the frame {frame}"))
    left = len(rows) - _MOST_WORKS
    if left > 0:
        rows[_MOST_WORKS:] = [("extents", f"and in {counted(left, 'more work object')}")]
    return rows


def _format_findings(findings: Sequence[Finding], place: Callable[[int], str]) -> str:
    """A line for each finding of a strict run; an unusual one is a remark."""
    lines = ""
    for finding in findings:
        kind = "remark: " if finding.level == "unusual" else ""
        lines += f"{place(finding.line)}: {kind}{finding.what}\n"
    return lines
