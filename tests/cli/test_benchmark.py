import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from plat.baselines import ReleasedTrackers
from plat.cli import benchmark
from plat.cli.benchmark import command_of
from plat.cli.benchmark_page import FIGURES, page, publish
from plat.cli.benchmark_page import main as publish_words
from plat.cli.options import BenchmarkRecipe
from plat.cli.settings import parse
from plat.errors import CheckpointError, OutputError, PlatError, RecordsError
from plat.evaluation import Entrant, authored_cells, study
from plat.evaluation.cells import Candidate, Cell
from plat.evaluation.disturbance import STRENGTHS, Strength
from plat.evaluation.study import Study
from plat.evaluation.study_files import TABLES
from plat.figures import pyplot
from plat.files import lock_file
from plat.modules import Expert, ExpertConfig, PlainPolicy
from plat.motions import MotionLibrary, save_motions
from plat.robots import G1
from plat.runs.lock import LOCK_FILE
from plat.spec.timing import Timing
from tests.conftest import standing_clip
from tests.evaluation.authored import authored_records
from tests.figures.scores import made_up
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import save_run, write_motions


def touch(figure: Any, stem: Path) -> list[Path]:
    """Stand in for the drawing of a figure, which takes longest."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    stem.with_suffix(".png").touch()
    pyplot().close(figure)
    return []


def quick(patch: pytest.MonkeyPatch) -> None:
    """Leave out what has tests of its own: figures and authored keyframes; one disturbance of one strength."""
    patch.setattr(study, "STRENGTHS", {**STRENGTHS, "friction": Strength("coefficient", (0.8, 0.1))})
    patch.setattr(benchmark, "save_figure", touch)
    patch.setattr(authored_cells, "evaluate_authored", lambda *_, **__: authored_records())


def recipe_in(folder: Path) -> BenchmarkRecipe:
    return BenchmarkRecipe(
        runs=(folder / "plain", folder / "expert"),
        out=folder / "out",
        hard=(folder / "motions.npz",),
        manifest=(folder / "manifest.csv",),
        generated=4.0,
        longest=1.2,
        clips=3,
        horizons=("short", "long", "mixed"),
        interface=("next-frame", "line"),
        robustness=("friction",),
        robustness_clips=1,
        authored=1,
        device="cpu",
        workers=1,
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> tuple[Path, dict[str, Study]]:
    """A folder with two tiny runs, two motions of 2 s and the benchmark of them, and what the benchmark returned."""
    pytest.importorskip("matplotlib")
    folder = tmp_path_factory.mktemp("finished")
    run = save_run(folder / "plain", PlainPolicy(G1, SMALL))
    save_run(folder / "expert", Expert(G1, ExpertConfig(hidden=(8,))))
    config = json.loads((run / "config.json").read_text())
    settings = {"motions": ["bandai_train.npz", "mine.npz"], "student": "plain"}
    (run / "config.json").write_text(json.dumps({**config, "recipe": {"name": "imagine", "settings": settings}}))
    write_motions(folder)
    (folder / "manifest.csv").write_text("clip,family\nrun_a,run\nwalk_b,walk\n")
    with pytest.MonkeyPatch.context() as patch:
        quick(patch)
        return folder, benchmark.main(recipe_in(folder))


@pytest.fixture
def recipe(finished, tmp_path, monkeypatch) -> BenchmarkRecipe:
    """The recipe of that benchmark, in a copy of the folder."""
    shutil.copytree(finished[0], tmp_path, dirs_exist_ok=True)
    quick(monkeypatch)
    return recipe_in(tmp_path)


def test_one_document_and_figures_of_every_kind(finished, recipe, monkeypatch):
    _, studies = finished
    assert list(studies) == ["motions", "generated"]
    found = studies["motions"]
    expert = next(score.policy for score in found.scores if score.policy.startswith("expert"))
    assert expert in ("expert (next-frame)", "expert (line)")
    assert [score.policy for score in found.scores] == ["plain", expert] * 3
    assert {score.policy for score in found.interfaces} == {"expert, next-frame", "expert, line"}
    # two motions of 2 s make four pieces of 1 s, of which three are taken
    pieces = found.scores[0].records[0]
    assert sorted(set(zip(pieces.clip.tolist(), pieces.source.tolist(), strict=True))) == [(0, 0), (1, 0), (2, 1)]
    assert {point.strength for point in found.curves} == {0.8, 0.1}
    assert list(found.groups) == [
        *("family", "difficulty", "family, humantracker", "family, supermimic", "authored"),
    ]
    assert [score.policy for score in found.dense] == ["expert"]
    assert [(score.rule, score.policy, score.count) for score in found.dense_clips] == [
        ("humantracker", "expert", 3),
        ("supermimic", "expert", 3),
    ]
    assert {one.group for one in found.groups["family"]} == {"run", "walk"}
    assert {one.policy for one in found.groups["authored"]} == {"plain", expert}
    assert {one.policy for one in found.differences} == {expert}
    assert {score.horizon for score in studies["generated"].scores} == {"long", "mixed"}
    assert not studies["generated"].curves
    drawn = {path.stem for path in (recipe.out / "motions").glob("*.png")}
    assert drawn == {
        "radar",
        "success",
        "horizon",
        "differences",
        "robustness",
        *("by_family", "by_family_humantracker", "by_family_supermimic", "by_difficulty", "by_authored"),
    }
    text = (recipe.out / "benchmark.md").read_text()
    assert text == page(recipe.out)
    for wanted in (
        "plat benchmark plain expert --hard motions.npz --manifest manifest.csv --generated 4 --longest 1.2",
        "- seed of the commands: 0",
        "- success rule `humantracker` of whole clips: height of",
        "- success rule `supermimic` of whole clips: height of",
        "| motions | motions.npz | 3 |",
        "| row | made by | trained on | SHA-256 of the weights |",
        "| plain | plat imagine, plain | bandai, mine |",
        "| expert | plat | not said in its file |",
        "### motions: authored keyframes",
        "| friction (coefficient) | 0.8 | 0.1 |",
        "| plain minus | horizon |",
        "| humantracker | plain | ",
        "### motions: with the dense reference",
        "| supermimic | expert | ",
        "TKS@3 (%) at Mixed, on 1 clip at most",
        "## generated",
    ):
        assert wanted in text, wanted
    assert str(recipe.out.parent) not in text
    linked = re.findall(r"\]\(([^)#]+)", text)
    assert len(linked) > 10
    assert [target for target in linked if not (recipe.out / target).exists()] == []
    assert "Evaluation (plat's docs/evaluation.md) says" in text
    # again: nothing is evaluated, and the same comes out
    monkeypatch.setattr(Cell, "evaluate", None)
    monkeypatch.setattr(authored_cells, "evaluate_authored", None)
    benchmark.main(recipe)
    assert (recipe.out / "benchmark.md").read_text() == text

    docs = recipe.out.parent / "docs"
    shutil.copytree(recipe.out / "motions", recipe.out / "earlier")  # a set of an earlier start
    publish(recipe.out, docs)
    kept = {path.name for path in (docs / "benchmark").iterdir()}
    assert kept == {"about.json", *(name for name, *_ in json.loads((recipe.out / "about.json").read_text())["sets"])}
    assert (docs / "results.md").read_text() == page(docs / "benchmark", "benchmark/")
    assert (docs / "benchmark" / "motions" / "radar.png").exists()
    assert "(benchmark/motions/radar.png)" in (docs / "results.md").read_text()


def test_the_command_in_the_document_means_the_same(recipe):
    words = command_of(recipe)
    assert words[:2] == ["plat", "benchmark"]
    again = parse(BenchmarkRecipe, words[2:])
    assert again.hard == (Path("motions.npz"),)
    assert command_of(again) == words
    assert (again.longest, again.horizons, again.interface) == (1.2, ("short", "long", "mixed"), ("next-frame", "line"))
    trackers = BenchmarkRecipe(out=Path("b"), trackers=ReleasedTrackers(sonic_1_1=Path("/far/away/sonic")), authored=0)
    assert command_of(trackers) == [
        *("plat", "benchmark", "--trackers.sonic-1-1", "sonic"),
        *("--authored", "0", "--out", "b"),
    ]


def test_a_row_that_is_not_there_is_named_before_the_evaluation(tmp_path):
    pytest.importorskip("matplotlib")
    run = save_run(tmp_path / "plain", PlainPolicy(G1, SMALL))
    with pytest.raises(PlatError, match="--ours 'PLAT': no such row, expected one of plain"):
        benchmark.main(BenchmarkRecipe(runs=(run,), out=tmp_path / "out", ours="PLAT", device="cpu"))


ABOUT = {
    "rules": [["fall", "it falls"]],
    "sets": [["val", "bandai", 3, 12.5, "abc"]],
    "rows": [["run", "def", "imagine", None]],
    "versions": ["plat 1"],
    "seed": 0,
    "longest": 30.0,
    "command": ["plat", "benchmark"],
}


def test_another_folder_is_refused(tmp_path, capsys):
    with pytest.raises(RecordsError, match="not the folder of a benchmark"):
        page(tmp_path)
    with pytest.raises(SystemExit, match="not the folder of a benchmark"):
        publish_words([str(tmp_path), str(tmp_path / "docs")])
    for text in ("[]", "{}", '{"rule": 1}', "[" * 100_000, json.dumps({**ABOUT, "longest": 10**400})):
        (tmp_path / "about.json").write_text(text)
        with pytest.raises(RecordsError, match="not the folder of a benchmark"):
            page(tmp_path)
    (tmp_path / "about.json").write_text(json.dumps(ABOUT))
    assert "it falls" in page(tmp_path)
    with pytest.raises(SystemExit, match="expected two folders"):
        publish_words([])


def benchmark_folder(path: Path) -> Path:
    """Make a folder of a benchmark without scores."""
    path.mkdir(parents=True)
    (path / "about.json").write_text(json.dumps(ABOUT))
    return path


@pytest.mark.parametrize("source", ["docs/benchmark", "docs/benchmark/earlier", "docs", "."])
def test_the_docs_do_not_replace_what_they_are_made_of(tmp_path, source):
    folder = benchmark_folder(tmp_path / "site" / source)
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="would replace .*, which it is a copy of: give the folder that plat"):
        publish(folder, tmp_path / "site" / "docs")
    assert {path.name for path in folder.iterdir() if path.is_file()} == {"about.json", "notes.txt"}


def test_a_folder_of_the_docs_that_is_no_copy_is_left_alone(tmp_path):
    folder, kept = benchmark_folder(tmp_path / "out"), tmp_path / "docs" / "benchmark"
    kept.mkdir(parents=True)
    (kept / "script.py").write_text("mine")
    with pytest.raises(OutputError, match="benchmark': no earlier copy of a benchmark, as it has no about.json"):
        publish(folder, tmp_path / "docs")
    assert (kept / "script.py").read_text() == "mine"


def test_a_copy_that_is_stopped_leaves_the_earlier_one(tmp_path, monkeypatch):
    folder, docs = benchmark_folder(tmp_path / "out"), tmp_path / "docs"
    publish(folder, docs)
    (docs / "benchmark" / "earlier.csv").touch()

    def full(path: Path, *_: object) -> None:
        raise OSError(28, "No space left on device", str(path))

    with monkeypatch.context() as patch:
        patch.setattr("plat.cli.benchmark_page.copy_file", full)
        with pytest.raises(SystemExit, match="error: '.*about.json': No space left on device"):
            publish_words([str(folder), str(docs)])
    assert (docs / "benchmark" / "earlier.csv").exists()
    publish(folder, docs)
    assert [path.name for path in (docs / "benchmark").iterdir()] == ["about.json"]
    assert {path.name for path in docs.iterdir()} == {"benchmark", "results.md"}


@pytest.mark.parametrize("window", [3, 5])
def test_another_arrival_window_is_said_before_the_tables(tmp_path, window):
    policy = Entrant.of_policy(PlainPolicy(G1, replace(SMALL, timing=Timing(window=window))))
    told = benchmark.about(BenchmarkRecipe(out=tmp_path), {Candidate("patient", lambda: policy, "abc"): policy}, [])
    (tmp_path / "about.json").write_text(json.dumps(told))
    assert ("- arrival window of 5 control steps, not 3\n" in page(tmp_path)) == (window == 5)


def test_a_folder_of_hard_motions_is_searched_once(tmp_path, monkeypatch):
    for name in ("a", "b"):
        (tmp_path / "hard" / name).mkdir(parents=True)
        save_motions(tmp_path / "hard" / name / "walk.npz", [standing_clip("walk")])
    (tmp_path / "manifest.csv").write_text("clip,family\nwalk,calm\n")
    searched: list[Path] = []
    search = os.walk
    monkeypatch.setattr(os, "walk", lambda folder, *more: searched.append(Path(folder)) or search(folder, *more))
    recipe = BenchmarkRecipe(
        out=tmp_path / "out", hard=(tmp_path / "hard",), manifest=(tmp_path / "manifest.csv",), generated=4.0
    )
    MotionLibrary.load(tmp_path / "hard")  # into the cache
    searched.clear()
    hard, _ = benchmark.motion_sets(recipe, G1, 0.02)
    assert hard.families == ["calm", "calm"]
    assert searched == [tmp_path / "hard"]


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ({"manifest": (Path("families.csv"),)}, "--manifest: takes effect only with --hard"),
        ({"robustness": (), "strengths": 3}, "--strengths: takes effect only with --robustness"),
        ({"robustness": (), "robustness_clips": 3}, "--robustness-clips: takes effect only with --robustness"),
        ({"further_horizons": ("short",)}, "--further-horizons: takes effect only with motions beside the generated"),
    ],
)
def test_flags_without_effect_are_refused_before_anything_is_read(tmp_path, flags, told):
    with pytest.raises(PlatError, match=told):
        benchmark.main(BenchmarkRecipe(runs=(tmp_path / "none",), out=tmp_path, device="cpu", **flags))


def test_an_interface_that_nothing_is_told_by_is_refused(tmp_path):
    pytest.importorskip("matplotlib")
    run = save_run(tmp_path / "plain", PlainPolicy(G1, SMALL))
    with pytest.raises(PlatError, match="--interface: takes effect only with a dense tracker"):
        benchmark.main(BenchmarkRecipe(runs=(run,), out=tmp_path / "out", interface=("line",), device="cpu"))


def test_a_name_that_is_no_text_becomes_one(tmp_path):
    """Records cannot be read from a folder of that name, and a page cannot hold it."""
    write_motions(tmp_path)
    hard = (tmp_path / "motions.npz").rename(tmp_path / os.fsdecode(b"K\xf6ln.npz"))
    recipe = replace(recipe_in(tmp_path), hard=(hard,), manifest=(), horizons=("short",))
    first, _ = benchmark.motion_sets(recipe, G1, 0.02)
    assert (first.name, first.source) == (r"K\udcf6ln", r"K\udcf6ln.npz")
    assert r"K\udcf6ln.npz" in command_of(recipe)


def test_sets_of_one_name_are_refused(tmp_path):
    for stem in ("hard", "generated"):
        recipe = BenchmarkRecipe(out=tmp_path, hard=(tmp_path / "a" / "hard.npz", tmp_path / "b" / f"{stem}.npz"))
        with pytest.raises(PlatError, match=f"--hard '.*b/{stem}.npz': there is a set '{stem}' already"):
            benchmark.motion_sets(recipe, G1, 0.02)


def test_tables_of_an_earlier_start_are_not_under_the_head_of_another(recipe, monkeypatch):
    text = (recipe.out / "benchmark.md").read_text()
    assert "## motions" in text
    assert "## generated" in text

    def stopped(*_, **__) -> Study:
        raise KeyboardInterrupt

    monkeypatch.setattr(benchmark, "run_study", stopped)
    with pytest.raises(KeyboardInterrupt):
        benchmark.main(recipe)
    assert page(recipe.out) == text  # what the same command has found stays
    with pytest.raises(KeyboardInterrupt):
        benchmark.main(replace(recipe, seed=5))
    assert "- seed of the commands: 5" in page(recipe.out)
    assert "## " not in page(recipe.out)
    assert not (recipe.out / "benchmark.md").exists()
    assert list((recipe.out / "motions" / "records").iterdir())


def test_one_benchmark_at_a_time_writes_into_a_folder(recipe):
    text = (recipe.out / "about.json").read_text()
    with (recipe.out / LOCK_FILE).open("a+") as file:
        lock_file(file)  # as another process would
        with pytest.raises(CheckpointError, match="is writing into it; wait until it ends, or choose another --out"):
            benchmark.main(replace(recipe, seed=6))
    assert (recipe.out / "about.json").read_text() == text


def test_pictures_of_an_earlier_start_do_not_stay(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(benchmark, "save_figure", touch)
    for name in ("radar.png", "radar.pdf", "photo.png", "paper.pdf"):
        (tmp_path / name).touch()
    benchmark.draw(tmp_path, Study(scores=made_up("PLAT", "wbc", horizons=("long", "mixed"))), 0.02)
    assert {path.name for path in tmp_path.iterdir()} == {"success.png", "horizon.png", "photo.png", "paper.pdf"}


def test_tables_and_pictures_of_others_stay(tmp_path):
    (tmp_path / "val").mkdir()
    for name in (*TABLES, *FIGURES, "mine.csv", "photo.png", "paper.pdf"):
        (tmp_path / "val" / name).touch()
    for seed in (1, 2):
        benchmark.write_about(tmp_path, {"sets": [["val"]], "seed": seed})
    assert {path.name for path in (tmp_path / "val").iterdir()} == {"mine.csv", "photo.png", "paper.pdf"}


def test_tables_stay_where_the_same_is_told(tmp_path):
    told = {"sets": [["val"]], "seed": 1}
    (tmp_path / "val").mkdir()
    (tmp_path / "val" / "scores.csv").touch()
    for text in (json.dumps(told, indent=1), json.dumps(told, indent=1) + "\n"):
        (tmp_path / "about.json").write_text(text)
        benchmark.write_about(tmp_path, told)
        assert (tmp_path / "val" / "scores.csv").exists()
        assert (tmp_path / "about.json").read_text() == json.dumps(told, indent=1) + "\n"


@pytest.mark.parametrize(
    ("flag", "path", "out"),
    [
        ("hard", "clips", "."),
        ("hard", "clips/clips.npz", "."),
        ("hard", "clips", "clips/results"),
        ("manifest", "generated/families.csv", "."),
        ("bandai", "bandai", "."),
    ],
)
def test_results_do_not_go_where_motions_are_read(tmp_path, flag, path, out):
    given = tmp_path / path
    recipe = BenchmarkRecipe(out=tmp_path / out, **{flag: given if flag == "bandai" else (given,)})
    with pytest.raises(OutputError, match=f"--{flag} '.*{path}': results go to '.*', which it is in or holds"):
        benchmark.motion_sets(recipe, G1, 0.02)
