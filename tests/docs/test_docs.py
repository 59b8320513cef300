"""The documents say what the code does: links, commands, settings, job files, and what is generated."""

import re
import shlex
import tomllib
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import fields
from io import StringIO
from pathlib import Path
from subprocess import CompletedProcess, run
from typing import Any

import pytest

from camgen.cli import main, make_parsers
from camgen.model.errors import CamgenError
from camgen.model.job_tables import list_settings, list_tables
from camgen.post.plugins import find_post, make_post
from camgen.read.job_file import from_mapping, load_job
from camgen.robots.catalogue import find_robot
from docs.make import pages
from docs.make.pictures import PICTURES, Shown, drawn
from docs.make.robots import reach

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FILES = sorted([ROOT / "README.md", *DOCS.glob("**/*.md")])
LINK = re.compile(r"\]\(([^()\s]+)\)")
SETTING = re.compile(rf"`({'|'.join(list_tables())})\.(\w+)")
#: A line that shows how a command is called, not a command: words in capitals, dots, brackets.
USAGE = re.compile(r"(?<![\w.])[A-Z]{3,}\b|\.\.\.|\[-|\[[A-Z]|\w\|\w")


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


each_page = pytest.mark.parametrize("page", FILES, ids=name)


def prose(text: str) -> str:
    """The text without its fenced and its inline code."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^```.*?^```", "", text, flags=re.S | re.M))


def anchors(text: str) -> set[str]:
    """The anchors of a page: those that a repository view makes, and mkdocs.yml asks for."""
    found: dict[str, int] = {}
    names = set()
    for heading in re.findall(
        r"^#+ +(.*)$", re.sub(r"^```.*?^```", "", text, flags=re.S | re.M), re.M
    ):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        slug = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        found[slug] = found.get(slug, -1) + 1
        names.add(f"{slug}-{found[slug]}" if found[slug] else slug)
    return names


@each_page
def test_every_link_leads_somewhere(page: Path) -> None:
    lost = []
    for target in LINK.findall(prose(page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", target):
            continue
        file, _, anchor = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        if not there.is_file() or (
            anchor and anchor not in anchors(there.read_text(encoding="utf-8"))
        ):
            lost.append(target)
    assert not lost


def test_anchors_are_those_of_a_repository_view() -> None:
    text = "# Options (`[post]`)\n## A - b, c's\n```\n# no heading\n```\n## A - b, c's\n### [x](y.md) z\n"
    assert anchors(text) == {"options-post", "a---b-cs", "a---b-cs-1", "x-z"}


def test_every_page_is_in_the_menu_once() -> None:
    # Not read as YAML: it holds a tag for Python.
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    assert sorted(re.findall(r"\S+\.md", menu)) == sorted(
        p.relative_to(DOCS).as_posix() for p in FILES[1:]
    )


@each_page
def test_lists_and_tables_stand_apart(page: Path) -> None:
    """A list right below a line of prose is a list in the repository view, and prose on the site."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    assert not re.findall(r"^(?![-|\d >#]|\s*$).*\n(?:- |\d\. |\|).*", text, re.M)


# -- commands


def commands(text: str) -> Iterator[tuple[str, bool]]:
    """What begins with camgen in code, and whether it is a line of its own."""
    blocks = re.findall(r"^```\w*[^\n]*\n(.*?)^```", text, re.S | re.M)
    rest = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    blocks += re.findall(r"(?:^ {4}.*\n)+", rest, re.M)
    for block in blocks:
        joined = re.sub(r"\\\n\s*", " ", block)
        for line in re.findall(r"^ *(?:\$ |time )?(?:\.venv/bin/)?(camgen .*)$", joined, re.M):
            yield line.split("  ")[0].rstrip(" &"), True
    for line in re.findall(r"`(camgen [^`\n]*)`", rest):
        yield line, False


@each_page
def test_every_command_is_one(page: Path) -> None:
    parser, known = make_parsers()
    for line, alone in commands(page.read_text(encoding="utf-8")):
        _, *words = shlex.split(line.partition(" > ")[0], comments=True)
        if words[0].startswith("-"):
            assert words[0] in parser._option_string_actions, line
            continue
        if words[0] == "COMMAND":
            continue
        assert words[0] in known, line
        options = {
            word.partition("=")[0] for word in words if word.startswith("--") and word != "--"
        }
        assert options <= set(known[words[0]]._option_string_actions), line
        if alone and not USAGE.search(line):
            checked(parser.parse_args(words), line)


def checked(arguments: object, line: str) -> None:
    """The settings and post options of a command are real ones."""
    sets = getattr(arguments, "sets", [])
    post = getattr(arguments, "post", None)
    job = load_job(
        None, [one for one in sets if not one.startswith("cell.file=") and ".urdf" not in one]
    )
    if post in pages.POSTS:
        make_post(find_post(post), job.post)
    else:
        assert post is None or post in ("krl", "./my_post.py"), line


def test_a_wrong_command_would_be_found() -> None:
    text = "    camgen build a.dxf --post rapid --set tool.diametr=2\n\nand `camgen bild` there\n"
    (line, alone), (inline, _) = commands(text)
    assert alone
    with pytest.raises(CamgenError, match="nearest is diameter"):
        checked(make_parsers()[0].parse_args(shlex.split(line)[1:]), line)
    assert inline == "camgen bild"


# -- settings


@each_page
def test_every_setting_exists(page: Path) -> None:
    known = {(one.table, one.key) for one in list_settings()}
    options = {
        option.name for post in pages.POSTS for option in fields(find_post(post)) if option.init
    }
    text = page.read_text(encoding="utf-8")
    named = set(SETTING.findall(text))
    assert not {
        (t, k) for t, k in named if (k not in options if t == "post" else (t, k) not in known)
    }


@each_page
def test_every_job_file_is_one(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```toml\n(.*?)^```", text, re.S | re.M)
    rest = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    blocks += [
        re.sub("^ {4}", "", b, flags=re.M)
        for b in re.findall(r"(?:^ {4}.*\n|^\n(?= {4}))+", rest, re.M)
    ]
    heads = "|".join(list_tables())
    for block in blocks:
        if re.match(rf"\s*(#.*\n)*\s*\[({heads})(\.\w+)?\]", block):
            job = tomllib.loads(block)
            if job.get("cell", {}).get("robot", "").endswith(".urdf"):
                continue
            from_mapping(job)


# -- generated pages


def run_in_process(words: list[str], *, check: bool, **options: Any) -> CompletedProcess[str]:
    """Stands in for ``subprocess.run`` of a shell. A ``camgen`` command runs in this process."""
    command = words[-1]
    if not command.startswith("camgen ") or re.search(r"[|<>]", command):
        return run(words, check=check, **options)  # type: ignore[no-any-return]
    printed = StringIO()
    with (
        chdir(options["cwd"]),
        redirect_stdout(printed),
        redirect_stderr(printed),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("COLUMNS", options["env"]["COLUMNS"])
        code = main(shlex.split(command)[1:])
    return CompletedProcess(words, code, printed.getvalue())


@pytest.mark.parametrize("page", pages.PAGES)
def test_what_is_generated_is_current(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """python -m docs.make.pages renews it."""
    monkeypatch.setattr("docs.make.pages.run", run_in_process)
    text = (DOCS / page).read_text(encoding="utf-8")
    assert pages.PAGES[page](text) == text


def test_a_table_of_options_shows_every_option() -> None:
    for post in pages.POSTS:
        page = DOCS / "posts" / f"{post}.md"
        rows = re.findall(r"^\| `(\w+)` \| `(.*?)` \|", page.read_text(encoding="utf-8"), re.M)
        shown = {key: tomllib.loads(f"x = {value}")["x"] for key, value in rows}
        assert make_post(find_post(post), shown) == find_post(post)()
        assert set(shown) == {one.name for one in fields(find_post(post)) if one.init}


def test_the_reach_of_arms_whose_lengths_are_known() -> None:
    # A SCARA: both links in a row. IRB 120 and IRB 2400: the reach of the data sheet is that of the wrist, and the
    # flange is 72 and 85 mm farther.
    assert reach(find_robot("Cobra s600")) == pytest.approx(325 + 275, abs=0.1)
    assert reach(find_robot("IRB 120")) == pytest.approx(580 + 72, abs=0.5)
    assert reach(find_robot("IRB 2400")) == pytest.approx(1550 + 85, abs=0.5)


@pytest.mark.parametrize(
    "picture", [p for p in PICTURES if p.name.endswith(".svg")], ids=lambda p: p.name
)
def test_pictures_are_current(picture: Shown) -> None:
    """python -m docs.make.pictures renews them."""
    assert (DOCS / "images" / picture.name).read_bytes() == drawn(picture)


def test_pictures_are_small_and_shown() -> None:
    shown = "".join(page.read_text(encoding="utf-8") for page in FILES)
    for picture in PICTURES:
        assert (DOCS / "images" / picture.name).stat().st_size < 60_000
        assert f"images/{picture.name}" in shown
