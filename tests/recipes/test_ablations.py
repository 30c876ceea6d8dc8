import contextlib
import dataclasses
import io
import json
import shutil
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest
import torch

from plat.cli import evaluate
from plat.envs.transforms import RandomizationRanges
from plat.errors import PlatError, WorkerError
from plat.evaluation import CommandRecords, Score
from plat.modules import Expert, ExpertConfig, LatentNoisePolicy, LatentPolicy, PlainPolicy, RefinementConfig
from plat.recipes import ablations
from plat.recipes.options import Training
from plat.robots import G1
from plat.runs import SavedRun, read_json, run_inputs, training_motions, write_json
from plat.runs.changes import settings_of
from tests.figures.scores import made_up
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import save_run, write_motions

pytest.importorskip("matplotlib")


STEPS = {"expert_steps": 9, "student_steps": 6, "refine_steps": 3, "imagine_steps": 2}


def refined() -> LatentNoisePolicy:
    return LatentNoisePolicy(LatentPolicy(G1, SMALL), RefinementConfig(hidden=(8,)))


def undrawn(patch: pytest.MonkeyPatch) -> None:
    """Leave out figures: their own tests draw them. Standing, slowly moved, is no harder."""
    patch.setattr(ablations, "HARD", ("calm",))
    for name in ("draw_scores", "draw_strips", "draw_groups"):
        patch.setattr(evaluate, name, lambda folder, *_, name=name: [folder / f"{name}.png"])


def recipe_in(folder: Path) -> ablations.AblationsRecipe:
    return ablations.AblationsRecipe(
        runs=folder / "runs",
        motions=(str(folder / "motions.npz"),),
        out=folder / "out",
        horizon=("long", "mixed"),
        device="cpu",
    )


@dataclasses.dataclass(frozen=True)
class Begun:
    """What the recipe did when it was started first, in a folder whose copies tests go on with."""

    folder: Path
    splits: dict[str, list[Score]]
    evaluated: list[tuple[str, str]]
    said: str


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Begun:
    """Three rows, PLAT with two seeds, scored once: nothing else takes as long here."""
    folder = tmp_path_factory.mktemp("begun")
    torch.manual_seed(0)
    save_run(folder / "runs" / "expert", Expert(G1, ExpertConfig(hidden=(8,))), steps=100)
    save_run(folder / "runs" / "dagger", LatentPolicy(G1, SMALL))
    for seed in (0, 1):
        save_run(folder / "runs" / f"plat-seed{seed}", refined(), steps=50)
    write_motions(folder, frames=21)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as said:
        undrawn(patch)
        calls = recorded(patch)
        splits = ablations.main(recipe_in(folder))
    return Begun(folder, splits, calls, said.getvalue())


@pytest.fixture
def scored(begun, tmp_path, monkeypatch) -> ablations.AblationsRecipe:
    """The recipe in a copy of the folder, with all that was evaluated."""
    shutil.copytree(begun.folder, tmp_path, dirs_exist_ok=True)
    undrawn(monkeypatch)
    return recipe_in(tmp_path)


@pytest.fixture
def recipe(scored) -> ablations.AblationsRecipe:
    """The recipe in a copy of the folder, before it was started."""
    shutil.rmtree(scored.out)
    return scored


def recorded(patch: pytest.MonkeyPatch, alike: bool = False) -> list[tuple[str, str]]:
    """Horizon and kind of every evaluation that is run; where policies count as alike, one is run for all of them."""
    calls: list[tuple[str, str]] = []
    found: dict[tuple[object, ...], CommandRecords] = {}
    original = evaluate.Entrant.evaluate

    def record(self, library, horizon, setting, **options):
        kind = "dense" if self.view.dense else "randomized" if setting.randomization else "plain"
        calls.append((horizon, kind))
        asked = (horizon, kind, repr(setting))
        if not alike or asked not in found:
            found[asked] = original(self, library, horizon, setting, **options)
        return found[asked]

    patch.setattr(evaluate.Entrant, "evaluate", record)
    return calls


@pytest.fixture
def evaluated(monkeypatch) -> list[tuple[str, str]]:
    return recorded(monkeypatch)


@pytest.fixture
def asked(monkeypatch) -> list[tuple[str, str]]:
    """For tests of what is evaluated and not of what comes out."""
    return recorded(monkeypatch, alike=True)


def test_rows_that_are_there_are_scored_in_the_papers_order(begun):
    splits, evaluated, out = begun.splits, begun.evaluated, begun.folder / "out"
    assert list(splits) == ["all", "hard", "randomized", "dense"]
    rows = ["Scratch RL", "DAgger", "PLAT"]
    cells = [(name, horizon) for horizon in ("long", "mixed") for name in rows]
    assert [(score.policy, score.horizon) for score in splits["all"]] == cells
    assert [len(score.records) for score in splits["all"][:3]] == [1, 1, 2]
    assert [(score.policy, score.horizon) for score in splits["dense"]] == [("Scratch RL", "mixed")]
    assert [score.figures for score in splits["hard"]] == [score.figures for score in splits["all"]]
    assert [(score.policy, score.horizon) for score in splits["randomized"]] == [(name, "mixed") for name in rows]
    assert evaluated.count(("long", "plain")) == evaluated.count(("mixed", "plain")) == 4
    assert evaluated.count(("mixed", "randomized")) == 4
    assert evaluated.count(("mixed", "dense")) == 1
    assert "Residual action: left out, no run" in begun.said
    assert "TWIST2: left out, give --trackers.twist2" in begun.said
    for split in splits:
        assert {path.name for path in (out / split).iterdir()} == {"scores.md", "scores.csv"}
    text = (out / "all" / "scores.md").read_text(encoding="utf-8")
    assert "| PLAT | plat-seed0 (50 steps), plat-seed1 (50 steps) |" in text
    assert "| DAgger | dagger |" in text
    commands = len(splits["all"][-1].records[0].clip)
    assert f"**by difficulty, mixed**\n\n| TKS@3 (%) | calm ({commands}) |" in text
    assert "by difficulty" not in (out / "hard" / "scores.md").read_text(encoding="utf-8")


def test_imagined_policies_are_rows_of_their_own_and_differences_are_plats(recipe, capsys):
    save_run(recipe.runs / "imagined", PlainPolicy(G1, SMALL), steps=100)
    save_run(recipe.runs / "imagined-latent-seed0", LatentPolicy(G1, SMALL), steps=100)
    rows = ablations.trained_rows(recipe)
    assert [name for name in ablations.ORDER if name in rows][-3:] == ["PLAT", "Imagined", "Imagined latent"]
    assert [candidate.slug for name in ("Imagined", "Imagined latent") for candidate in rows[name]] == [
        "imagined",
        "imagined-latent-seed0",
    ]
    (plat,) = made_up("PLAT")[:1]
    scores = [plat, dataclasses.replace(plat, policy="Imagined")]
    ablations.write_table(recipe.out / "all", scores, {name: rows[name] for name in ("PLAT", "Imagined")})
    assert "PLAT minus" in (recipe.out / "all" / "scores.md").read_text(encoding="utf-8")
    assert "Imagined: left out" not in capsys.readouterr().out


def test_figures_of_every_split_and_strips_of_one(scored, monkeypatch):
    drawn = []
    monkeypatch.setattr(evaluate, "draw_scores", lambda folder, scores: drawn.append((folder.name, scores)) or [])
    monkeypatch.setattr(evaluate, "draw_strips", lambda *arguments: drawn.append(("strips", arguments)) or [])
    splits = ablations.main(dataclasses.replace(scored, clip="walk"))
    *figures, (_, (folder, entrants, library, clip, horizons, _, _)) = drawn
    assert dict(figures) == splits
    assert folder == scored.out / "all"
    assert list(entrants) == ["Scratch RL", "DAgger", "PLAT"]
    assert (library.clip_names, library.clip_names[clip]) == (["run_a", "walk_b"], "walk_b")
    assert horizons == scored.horizon


def test_a_row_that_is_not_finished_is_said_to_be(recipe, capsys):
    config = recipe.runs / "dagger" / "config.json"
    config.write_text(json.dumps({**json.loads(config.read_text()), "recipe": {"name": "distill"}}))
    rows = ablations.trained_rows(recipe)
    assert f"DAgger: {recipe.runs / 'dagger'} is not finished" in capsys.readouterr().out
    described = {name: [ablations.described(one) for one in row] for name, row in rows.items()}
    assert described["DAgger"] == ["dagger (not finished)"]
    assert described["PLAT"] == ["plat-seed0 (50 steps)", "plat-seed1 (50 steps)"]


def test_what_is_known_is_not_evaluated_again(begun, scored, asked):
    again = ablations.main(scored)
    assert asked == []
    assert [score.figures for score in again["hard"]] == [score.figures for score in begun.splits["hard"]]
    save_run(scored.runs / "plat-seed1", refined(), steps=60)  # trained further
    ablations.main(scored)
    assert sorted(asked) == [("long", "plain"), ("mixed", "plain"), ("mixed", "randomized")]
    asked.clear()
    ablations.main(dataclasses.replace(scored, randomization=RandomizationRanges(foot_friction=(0.3, 0.3))))
    assert asked == [("mixed", "randomized")] * 4
    asked.clear()
    ablations.main(dataclasses.replace(scored, seed=1))  # other commands
    assert len(asked) == 3 * 4 + 1


def test_a_broken_record_is_made_again(scored, evaluated, capsys):
    (scored.out / "records" / "dagger-long.safetensors").write_bytes(b"half a file")
    ablations.main(scored)
    assert evaluated == [("long", "plain")]
    assert "evaluated again" in capsys.readouterr().out


def test_without_hard_commands_there_is_no_hard_split(scored, monkeypatch, capsys):
    monkeypatch.setattr(ablations, "HARD", ("brisk", "hard"))
    for old in ("all/radar.png", "hard/success.pdf", "hard/notes.txt"):  # of an earlier start, but for the last
        (scored.out / old).touch()
    assert list(ablations.main(scored)) == ["all", "randomized", "dense"]
    assert [path.name for path in (scored.out / "hard").iterdir()] == ["notes.txt"]
    assert not (scored.out / "all" / "radar.png").exists()
    assert "brisk and hard: 0 of " in capsys.readouterr().out


def test_the_hard_split_has_the_commands_of_its_bins():
    (score,) = made_up("PLAT")[1:2]
    labels = ["hard", "calm"] * (len(score.records[0].clip) // 2)
    bins = {score.horizon: labels}
    (hard,) = ablations.hard_part([score], bins)
    assert torch.equal(hard.records[0].failed, score.records[0].failed[::2])
    assert [one.group for one in ablations.grouped([score], bins, score.horizon)] == ["calm", "hard"]


def test_an_empty_folder_is_named(recipe, tmp_path):
    with pytest.raises(PlatError, match="holds none of the runs"):
        ablations.main(dataclasses.replace(recipe, runs=tmp_path / "nowhere"))


@pytest.fixture
def trained(monkeypatch) -> list:
    """Recipes that would have been trained; they leave a finished run."""
    made = []

    def train(recipe):
        made.append(recipe)
        policy = (
            Expert(G1, ExpertConfig(hidden=(8,))) if "ExpertRecipe" in str(type(recipe)) else LatentPolicy(G1, SMALL)
        )
        save_run(recipe.out, policy, steps=recipe.steps)

    for name in ("expert", "distill", "refine", "imagine"):
        monkeypatch.setattr(sys.modules[f"plat.recipes.{name}"], "main", train)
    return made


def test_every_row_is_trained_with_the_budget_of_its_stage(recipe, trained, tmp_path):
    training = Training(
        motions=("train.npz",), expert_steps=9, student_steps=6, refine_steps=3, imagine_steps=2, seeds=(4, 5)
    )
    recipe = dataclasses.replace(recipe, runs=tmp_path / "new", training=training)
    ablations.train(recipe)
    names = ["sonic-style", "expert", "plain", "dagger"]
    names += [f"{name}-seed{seed}" for name in ("finetune", "action", "plat") for seed in (4, 5)]
    names += ["imagined", "imagined-latent"]
    assert [made.out.name for made in trained] == names
    assert [made.steps for made in trained] == [9, 9, 6, 6] + [3] * 6 + [2] * 2
    assert [made.seed for made in trained] == [4, 4, 4, 4] + [4, 5] * 3 + [4, 4]
    assert all(made.motions == ("train.npz",) and not made.resume for made in trained)
    assert trained[0].policy == dataclasses.replace(trained[1].policy, ahead=(1, 2, 6, 11, 16, 21, 26, 31, 36, 41))
    assert trained[1].policy == ablations.expert.ExpertRecipe(motions=("train.npz",), out=tmp_path).policy
    assert [made.student for made in trained[2:4]] == ["plain", "latent"]
    assert trained[2].expert == trained[3].expert == tmp_path / "new" / "expert"
    assert [made.variant for made in trained[4:-2:2]] == ["finetune", "action", "latent"]
    assert [(made.name, made.student) for made in trained[-2:]] == [("imagine", "plain"), ("imagine", "latent")]
    assert [made.posterior for made in trained[-2:]] == [0, 0.5]
    # within a stage nothing differs but what the row is about
    about = {"student", "variant", "out", "seed", "policy", "posterior"}
    for stage in (trained[:2], trained[2:4], trained[4:-2], trained[-2:]):
        settings = [
            {field.name: getattr(made, field.name) for field in dataclasses.fields(made) if field.name not in about}
            for made in stage
        ]
        assert all(other == settings[0] for other in settings)


def test_rows_that_are_done_are_not_trained_again(recipe, trained, tmp_path, capsys):
    training = Training(
        motions=("train.npz",), expert_steps=9, student_steps=6, refine_steps=3, imagine_steps=2, seeds=(0,)
    )
    recipe = dataclasses.replace(recipe, runs=tmp_path / "new", training=training)
    ablations.train(recipe)
    trained.clear()
    ablations.train(recipe)
    assert trained == []
    assert "PLAT: " in capsys.readouterr().out
    save_run(tmp_path / "new" / "plat-seed0", refined())  # never finished
    further = dataclasses.replace(recipe, training=dataclasses.replace(training, student_steps=7))
    ablations.train(further)
    assert [made.out.name for made in trained] == ["plain", "dagger", "plat-seed0"]


def finish(training: ablations.Planned, policy) -> None:
    """A finished run of a training, as the recipe leaves it."""
    save_run(training.out, policy, steps=training.recipe.steps)
    config = read_json(training.out / "config.json")
    made = {"name": training.recipe.name, "settings": settings_of(training.recipe)}
    write_json(training.out / "config.json", {**config, "recipe": made})
    teacher = getattr(training.recipe, "expert", None)
    loaded = {"expert": SavedRun(teacher).policy()} if teacher else {}
    write_json(training.out / "inputs.json", run_inputs(training_motions(training.recipe, 0.02), **loaded))


def test_rows_that_were_trained_otherwise_are_no_done_rows(recipe, tmp_path, capsys):
    motions = (write_motions(tmp_path, frames=21),)
    training = Training(
        motions=motions, num_envs=2, expert_steps=9, student_steps=6, refine_steps=3, imagine_steps=2, seeds=(0,)
    )
    recipe = dataclasses.replace(recipe, runs=tmp_path / "new", training=training)
    rows = {planned.out.name: planned for planned in ablations.planned(recipe)}
    finish(rows["expert"], Expert(G1, ExpertConfig(hidden=(8,))))
    finish(rows["dagger"], LatentPolicy(G1, SMALL))
    capsys.readouterr()
    assert {planned.out.name for planned in ablations.planned(recipe)} == set(rows) - {"expert", "dagger"}
    assert "DAgger: " in capsys.readouterr().out
    longer = dataclasses.replace(training, expert_steps=10)
    with pytest.raises(PlatError, match="^DAgger: .*dagger' was made from 'expert' as it is, which would train on: "):
        ablations.planned(dataclasses.replace(recipe, training=longer))
    finish(rows["imagined"], PlainPolicy(G1, SMALL))
    assert "imagined" not in {planned.out.name for planned in ablations.planned(recipe)}
    longer = dataclasses.replace(training, student_steps=7, refine_steps=4)
    assert len(ablations.planned(dataclasses.replace(recipe, training=longer))) == len(rows) - 2
    more = dataclasses.replace(training, num_envs=4, mirror=True)
    with pytest.raises(
        PlatError, match=r"^Scratch RL: '.*expert' was trained otherwise: mirror is True, was False; num"
    ):
        ablations.planned(dataclasses.replace(recipe, training=more))
    write_motions(tmp_path, frames=31)
    with pytest.raises(PlatError, match="^Scratch RL: .*: motions: clip 0 'run_a' has .* frames, had"):
        ablations.planned(recipe)
    write_motions(tmp_path, frames=21)
    finish(rows["expert"], Expert(G1, ExpertConfig(hidden=(8,))))  # another one
    with pytest.raises(PlatError, match="^DAgger: .* was trained otherwise: expert: other content; "):
        ablations.planned(recipe)


def test_training_needs_motions(recipe):
    with pytest.raises(PlatError, match="--training.motions"):
        ablations.main(dataclasses.replace(recipe, train=True))


def in_turn(tasks):
    """Tasks of a cluster, in this process: one after the other, and none whose need failed."""
    failed = set()
    for task in tasks:
        error = WorkerError("needs another") if failed & set(task.needs) else None
        try:
            if error is None:
                task.work()
        except PlatError as raised:
            error = raised
        failed |= {task.name} if error else set()
        yield task, error


@pytest.fixture
def on_cluster(monkeypatch):
    """Run the tasks of a cluster in this process; the names of those that were."""
    names = []

    def run(tasks, cluster):
        for task, error in in_turn(tasks):
            names.append((task.name, task.needs))
            yield task, error

    monkeypatch.setattr(ablations, "Cluster", contextlib.nullcontext)
    monkeypatch.setattr(ablations, "run_tasks", run)
    monkeypatch.setenv("PLAT_CPUS", "")
    return names


def test_a_cluster_scores_the_same(begun, recipe, evaluated, on_cluster, capsys):
    splits = ablations.main(dataclasses.replace(recipe, ray=True))
    assert on_cluster == [(f"score {name}", ()) for name in ("expert", "dagger", "plat-seed0", "plat-seed1")]
    assert len(evaluated) == 3 * 4 + 1  # none of them twice
    assert {name: [score.figures for score in scores] for name, scores in splits.items()} == {
        name: [score.figures for score in scores] for name, scores in begun.splits.items()
    }
    alone = (begun.folder / "out" / "all" / "scores.md").read_text()
    assert (recipe.out / "all" / "scores.md").read_text() == alone
    assert "0 trainings and 4 evaluations" in capsys.readouterr().out


def test_rows_are_in_the_table_as_soon_as_they_are_scored(
    recipe, trained, asked, on_cluster, monkeypatch, tmp_path, capsys
):
    tables = []
    write = ablations.write_table

    def written(folder, scores, rows, groups=()):
        tables.append({name: [candidate.slug for candidate in row] for name, row in rows.items()})
        write(folder, scores, rows, groups)

    monkeypatch.setattr(ablations, "write_table", written)
    training = Training(
        motions=("train.npz",), expert_steps=9, student_steps=6, refine_steps=3, imagine_steps=2, seeds=(0, 1)
    )
    recipe = dataclasses.replace(
        recipe, runs=tmp_path / "new", training=training, train=True, ray=True, horizon=("long",)
    )
    save_run(tmp_path / "new" / "expert", Expert(G1, ExpertConfig(hidden=(8,))), steps=9)
    save_run(tmp_path / "new" / "action-seed0", refined())  # never finished
    ablations.main(recipe)
    assert [made.out.name for made in trained if made.resume] == ["action-seed0"]
    needs = dict(on_cluster)
    assert "train expert" not in needs
    assert needs["train plain"] == needs["score expert"] == ()
    assert needs["train plat-seed1"] == ("train dagger",)
    assert needs["score plat-seed1"] == ("train plat-seed1",)
    assert tables[0] == {"SONIC-style": ["sonic-style"]}
    assert tables[1] == {"SONIC-style": ["sonic-style"], "Scratch RL": ["expert"]}
    assert [row["PLAT"] for row in tables if "PLAT" in row][:2] == [["plat-seed0"], ["plat-seed0", "plat-seed1"]]
    assert len(capsys.readouterr().out.split("PLAT ")) > 2
    assert (recipe.out / "logs" / "plat-seed1.txt").exists()


def test_rows_that_fail_leave_the_others_alone(recipe, trained, asked, on_cluster, monkeypatch, tmp_path, capsys):
    def broken(recipe):
        raise PlatError("no such teacher")

    monkeypatch.setattr(sys.modules["plat.recipes.distill"], "main", broken)
    training = Training(
        motions=("train.npz",), expert_steps=9, student_steps=6, refine_steps=3, imagine_steps=2, seeds=(0,)
    )
    recipe = dataclasses.replace(recipe, runs=tmp_path / "new", training=training, train=True, ray=True)
    with pytest.raises(PlatError, match=r"^10 of 18 tasks failed, the first of them 'train plain' \(no such teacher\)"):
        ablations.main(recipe)
    assert [made.out.name for made in trained] == ["sonic-style", "expert", "imagined", "imagined-latent"]
    assert "train plat-seed0: needs another" in capsys.readouterr().out
    assert "Scratch RL" in (recipe.out / "all" / "scores.md").read_text()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"training": Training(motions=("a.npz",))}, "--training.motions: takes effect only with --train"),
        ({"training": Training(expert_steps=9)}, "--training.expert-steps: takes effect only with --train"),
        ({"training": Training(cpus=1), "train": True}, "--training.cpus: takes effect only with --ray"),
    ],
)
def test_settings_of_no_training_are_refused(recipe, settings, message):
    with pytest.raises(PlatError, match=message):
        ablations.main(dataclasses.replace(recipe, **settings))
    assert not recipe.out.exists()
    ablations.check_training(dataclasses.replace(recipe, **{**settings, "train": True, "ray": True}))
