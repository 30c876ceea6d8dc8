"""README, documentation and weights name what exists."""

import importlib
import inspect
import re
import tomllib
from pathlib import Path

import pytest

from plat.cli import COMMANDS
from tests.cli.pages import calls

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("plat/**/*.md"), *ROOT.glob(".github/**/*.md")]
)
FOLDERS = "plat(?!/G1)|recipes|benchmarks|docs|tests|examples"


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def prose(page: Path) -> str:
    """Text without code blocks."""
    return re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)


def resolve(name: str) -> object:
    """What a dotted name stands for.

    Raises:
        AttributeError: if there is no such thing.
    """
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            found = getattr(found, part)
        return found
    raise AttributeError(name)


def files_named(text: str) -> set[str]:
    return set(re.findall(rf"`((?:{FOLDERS})/[\w/.-]*)`", text))


def links(text: str) -> set[str]:
    return {target for target in re.findall(r"\]\(([^)#\s]+)", text) if not target.startswith(("http", "mailto"))}


def dotted_names(text: str) -> set[str]:
    names = set(re.findall(r"`(plat(?:\.\w+)+)(?:\(.*?\))?`", text))
    return {name for name in names if not name.endswith((".json", ".npz", ".csv"))}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_that_are_named_exist(page):
    text = prose(page)
    missing = {path for path in files_named(text) if not (ROOT / path).exists()}
    missing |= {target for target in links(text) if not (page.parent / target).exists()}
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_names_in_the_package_exist(page):
    moved = page.name == "CHANGELOG.md"  # it tells old names too
    missing = set()
    for name in dotted_names(prose(page)) if not moved else ():
        try:
            resolve(name)
        except AttributeError:
            missing.add(name)
    assert not missing


def headings(text: str) -> set[str]:
    """Anchors of the headings of a page, as GitHub makes them of their words."""
    words = [re.sub(r"\[(.*?)\]\(.*?\)", r"\1", heading) for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE)]
    return {re.sub(r"[^\w\- ]", "", word.strip().lower()).replace(" ", "-") for word in words}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_headings_that_are_linked_exist(page):
    linked = re.findall(r"\]\(((?!http)[^)#\s]*)#([^)\s]+)\)", prose(page))
    there = {target: headings(prose(page.parent / target if target else page)) for target, _ in linked}
    assert not {(target, name) for target, name in linked if name not in there[target]}


def test_what_is_missing_is_found():
    text = "`plat/nothing.py`, [page](nowhere.md), `plat.motions.Nothing`, [paper](https://arxiv.org/abs/2609.25754)"
    assert files_named(text) == {"plat/nothing.py"}
    assert links(text) == {"nowhere.md"}
    assert headings("# [Both](x.md) sides, `now`\n## Two") == {"both-sides-now", "two"}
    (name,) = dotted_names(text)
    with pytest.raises(AttributeError):
        resolve(name)


def test_all_pages_are_in_the_index_and_on_the_site():
    pages = {str(page.relative_to(ROOT / "docs")) for page in ROOT.glob("docs/**/*.md")}
    assert links((ROOT / "docs" / "index.md").read_text()) >= pages - {"index.md"}
    site = tomllib.loads((ROOT / "zensical.toml").read_text())["project"]["nav"]
    assert set(re.findall(r"'([\w/]+\.md)'", str(site))) == pages


@pytest.mark.parametrize("page", [page for page in PAGES if ".github" not in page.parts], ids=name_of)
def test_prose_is_wrapped(page):
    lines = prose(page).splitlines()
    text = [line for line in lines if not line.lstrip().startswith(("|", "<", "!["))]
    assert [line for line in text if len(line) > 100] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_numbers_have_a_leading_zero(page):
    text = re.sub(r"`[^`\n]*`", "", prose(page))
    assert re.findall(r"(?<![\w.)\]])\.\d+", text) == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_tables_stand_alone(page):
    """A line that touches a table is a row of it on the site."""
    rows = [line.lstrip().startswith("|") for line in ["", *prose(page).splitlines(), ""]]
    blank = [not line.strip() for line in ["", *prose(page).splitlines(), ""]]
    edges = [number for number in range(1, len(rows)) if rows[number] != rows[number - 1]]
    assert [number for number in edges if not (blank[number] or blank[number - 1])] == []


def paragraphs(text: str) -> list[str]:
    """Return paragraphs and items as a line each."""
    parts = re.split(r"\n\s*\n|\n(?=\s*(?:- |\d+\. ))", text)
    return [" ".join(part.split()) for part in parts if part.strip()]


def test_paragraphs_are_told_apart():
    assert paragraphs("One\ntwo.\n\n- three\n  four\n- five\n") == ["One two.", "- three four", "- five"]


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "results.md"], ids=name_of)
def test_no_item_or_paragraph_is_told_twice(page):
    told = [part for part in paragraphs(prose(page)) if len(part) > 80 and not part.startswith("|")]
    assert {part for part in told if told.count(part) > 1} == set()


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 120


def commands_named(text: str) -> set[str]:
    in_blocks = {call.words[0] for call in calls(text) if call.words}
    return in_blocks | set(re.findall(r"`plat ([a-z][\w-]*)", text))


def test_commands_in_the_docs_exist():
    named = {command for page in PAGES for command in commands_named(page.read_text())}
    assert len(named) > 8
    assert named <= set(COMMANDS)


def test_the_table_of_extras_is_complete():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    rows = re.findall(r"^\| (`.*?) \| (.*) \|$", (ROOT / "docs" / "index.md").read_text().split("| extra |")[1], re.M)
    listed = [name for names, _ in rows for name in re.findall("`(.*?)`", names)]
    assert sorted(listed) == sorted(extras)
    (within,) = (re.findall(r"[\w-]+", one)[1:] for one in extras["dev"] if one.startswith("plat-rl["))
    (told,) = (told for names, told in rows if "`dev`" in names)
    assert set(re.findall("`(.*?)`", told)) == set(extras) - set(within) - {"dev"}


ROLE = re.compile(r":(?:attr|class|data|exc|func|meth|mod):`~?(plat\.[\w.]+)`")
SOURCES = sorted(path for path in ROOT.glob("plat/**/*.py") if path.is_file())


def is_there(name: str) -> bool:
    """Whether a dotted name of a docstring stands for something, be it what instances of a class alone have."""
    owner, _, attribute = name.rpartition(".")
    try:
        kind = resolve(owner)
        if isinstance(kind, type) and re.search(rf"self\.{attribute}\b", inspect.getsource(kind)):
            return True
        resolve(name)
    except AttributeError:
        return False
    return True


@pytest.mark.filterwarnings("ignore::FutureWarning")  # of an old name, which is there
def test_references_in_docstrings_exist():
    named = {(name, name_of(path)) for path in SOURCES for name in ROLE.findall(path.read_text())}
    assert len(named) > 100
    assert not {(name, page) for name, page in named if not is_there(name)}


def test_a_reference_to_nothing_is_found():
    (name,) = ROLE.findall(":func:`~plat.export.run_card`, :class:`Run`")
    assert not is_there(name)
    assert is_there("plat.modules.Expert.goals")
    assert not is_there("plat.modules.Expert.gaols")
