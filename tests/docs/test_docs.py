"""The documents agree with the code: links, commands, settings, job files and generated pages."""

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
from docs.make import pages, stock_picture
from docs.make.pictures import PICTURES, PictureSpec, draw
from docs.make.robots import reach

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FILES = sorted([ROOT / "README.md", *DOCS.glob("**/*.md")])
LINK = re.compile(r"\]\(([^()\s]+)\)")
SETTING = re.compile(rf"`({'|'.join(list_tables())})\.(\w+)")
#: Words in capitals, dots and brackets of a line that shows the usage of a command.
USAGE = re.compile(r"(?<![\w.])[A-Z]{3,}\b|\.\.\.|\[-|\[[A-Z]|\w\|\w")


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


each_page = pytest.mark.parametrize("page", FILES, ids=name)


def remove_code(text: str) -> str:
    """The text without its fenced and its inline code."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^```.*?^```", "", text, flags=re.S | re.M))


def list_anchors(text: str) -> set[str]:
    """The anchors of a page as a repository view makes them. mkdocs.yml makes the same."""
    counts: dict[str, int] = {}
    names = set()
    for heading in re.findall(
        r"^#+ +(.*)$", re.sub(r"^```.*?^```", "", text, flags=re.S | re.M), re.M
    ):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        slug = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        counts[slug] = counts.get(slug, -1) + 1
        names.add(f"{slug}-{counts[slug]}" if counts[slug] else slug)
    return names


@each_page
def test_each_link_leads_to_a_page_and_an_anchor(page: Path) -> None:
    dead_links = []
    for target in LINK.findall(remove_code(page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", target):
            continue
        file, _, anchor = target.partition("#")
        target_page = (page.parent / file).resolve() if file else page
        if not target_page.is_file():
            dead_links.append(target)
            continue
        if anchor and anchor not in list_anchors(target_page.read_text(encoding="utf-8")):
            dead_links.append(target)
    assert not dead_links


def test_anchors_are_those_of_a_repository_view() -> None:
    text = (
        "# Options (`[post]`)\n## A - b, c's\n```\n# no heading\n```\n## A - b, c's\n"
        "### [x](y.md) z\n"
    )
    assert list_anchors(text) == {"options-post", "a---b-cs", "a---b-cs-1", "x-z"}


def test_each_page_is_in_the_menu_once() -> None:
    # The file is not read as YAML, because it holds a tag for Python.
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    assert sorted(re.findall(r"\S+\.md", menu)) == sorted(
        p.relative_to(DOCS).as_posix() for p in FILES[1:]
    )


@each_page
def test_lists_and_tables_follow_an_empty_line(page: Path) -> None:
    """A list right below a line of prose is a list in the repository view, but not on the site."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    assert not re.findall(r"^(?![-|\d >#]|\s*$).*\n(?:- |\d\. |\|).*", text, re.M)


# -- commands


def list_commands(text: str) -> Iterator[tuple[str, bool]]:
    """The text of each command of camgen, and whether it is a line of a block."""
    blocks = re.findall(r"^```\w*[^\n]*\n(.*?)^```", text, re.S | re.M)
    unfenced = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    blocks += re.findall(r"(?:^ {4}.*\n)+", unfenced, re.M)
    for block in blocks:
        joined = re.sub(r"\\\n\s*", " ", block)
        for line in re.findall(r"^ *(?:\$ |time )?(?:\.venv/bin/)?(camgen .*)$", joined, re.M):
            yield line.split("  ")[0].rstrip(" &"), True
    for line in re.findall(r"`(camgen [^`\n]*)`", unfenced):
        yield line, False


@each_page
def test_each_command_is_parsed(page: Path) -> None:
    parser, known = make_parsers()
    for line, is_complete in list_commands(page.read_text(encoding="utf-8")):
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
        if is_complete and not USAGE.search(line):
            check_settings(parser.parse_args(words), line)


def check_settings(arguments: object, line: str) -> None:
    """The settings and options of a command must exist."""
    sets = getattr(arguments, "sets", [])
    post = getattr(arguments, "post", None)
    job = load_job(
        None,
        [
            setting
            for setting in sets
            if not setting.startswith("cell.file=") and ".urdf" not in setting
        ],
    )
    if post in pages.POSTS:
        make_post(find_post(post), job.post)
    else:
        assert post is None or post in ("krl", "./my_post.py"), line


def test_a_wrong_command_is_found() -> None:
    text = "    camgen build a.dxf --post rapid --set tool.diametr=2\n\nand `camgen bild` there\n"
    (line, is_complete), (inline, _) = list_commands(text)
    assert is_complete
    with pytest.raises(CamgenError, match="nearest is diameter"):
        check_settings(make_parsers()[0].parse_args(shlex.split(line)[1:]), line)
    assert inline == "camgen bild"


# -- settings


@each_page
def test_each_setting_exists(page: Path) -> None:
    settings = {(setting.table, setting.key) for setting in list_settings()}
    options: set[str] = set()
    for post in pages.POSTS:
        options |= {option.name for option in fields(find_post(post)) if option.init}
    text = page.read_text(encoding="utf-8")
    named = set(SETTING.findall(text))
    assert {key for table, key in named if table == "post"} <= options
    assert {setting for setting in named if setting[0] != "post"} <= settings


@each_page
def test_each_job_file_is_valid(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```toml\n(.*?)^```", text, re.S | re.M)
    unfenced = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    blocks += [
        re.sub("^ {4}", "", b, flags=re.M)
        for b in re.findall(r"(?:^ {4}.*\n|^\n(?= {4}))+", unfenced, re.M)
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
    """Replaces `subprocess.run` of a shell. A `camgen` command runs in this process."""
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
def test_generated_pages_are_current(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """python -m docs.make.pages renews it."""
    monkeypatch.setattr("docs.make.pages.run", run_in_process)
    text = (DOCS / page).read_text(encoding="utf-8")
    assert pages.PAGES[page](text) == text


def test_the_table_of_options_shows_all_options() -> None:
    for post in pages.POSTS:
        page = DOCS / "posts" / f"{post}.md"
        rows = re.findall(r"^\| `(\w+)` \| `(.*?)` \|", page.read_text(encoding="utf-8"), re.M)
        values = {key: tomllib.loads(f"x = {value}")["x"] for key, value in rows}
        assert make_post(find_post(post), values) == find_post(post)()
        assert set(values) == {option.name for option in fields(find_post(post)) if option.init}


def test_the_reach_of_arms_follows_from_their_lengths() -> None:
    # A SCARA reaches as far as both links together. The reach in the data sheets of IRB 120 and IRB
    # 2400 is that of the wrist; the flange is 72 and 85 mm farther.
    assert reach(find_robot("Cobra s600")) == pytest.approx(325 + 275, abs=0.1)
    assert reach(find_robot("IRB 120")) == pytest.approx(580 + 72, abs=0.5)
    assert reach(find_robot("IRB 2400")) == pytest.approx(1550 + 85, abs=0.5)


@pytest.mark.parametrize(
    "picture", [p for p in PICTURES if p.name.endswith(".svg")], ids=lambda p: p.name
)
def test_pictures_are_current(picture: PictureSpec) -> None:
    """python -m docs.make.pictures renews them."""
    assert (DOCS / "images" / picture.name).read_bytes() == draw(picture)


def test_the_picture_of_the_stock_is_current(tmp_path: Path) -> None:
    """python -m docs.make.stock_picture renews it."""
    stock_picture.main(tmp_path)
    assert (DOCS / "images" / "stock.svg").read_bytes() == (tmp_path / "stock.svg").read_bytes()


def test_pictures_are_small_and_shown() -> None:
    texts = "".join(page.read_text(encoding="utf-8") for page in FILES)
    for picture in PICTURES:
        assert (DOCS / "images" / picture.name).stat().st_size < 60_000
        assert f"images/{picture.name}" in texts
