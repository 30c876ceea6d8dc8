import csv
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plat.baselines import ReleasedTrackers
from plat.cli import evaluate
from plat.control.authored import author
from plat.envs.transforms import HORIZONS, RandomizationRanges
from plat.errors import CheckpointError, MotionError, OutputError, PlatError
from plat.evaluation import authored_cells, entrant
from plat.evaluation.study import Study
from plat.files import lock_file
from plat.modules import Expert, ExpertConfig, PlainPolicy
from plat.motions import files, save_motions
from plat.robots import G1
from plat.runs.lock import LOCK_FILE
from plat.spec.timing import Timing
from tests.conftest import standing_clip
from tests.evaluation.authored import authored_records
from tests.modules.policies.test_student import SMALL
from tests.motions.formats.writers import bowing_clip, write_csv
from tests.recipes.runs import save_run, write_motions


@pytest.fixture
def runs(tmp_path):
    save_run(tmp_path / "expert", Expert(G1, ExpertConfig(hidden=(8,))))
    save_run(tmp_path / "far-sighted", Expert(G1, ExpertConfig(hidden=(8,), ahead=(1, 6))))
    save_run(tmp_path / "plain", PlainPolicy(G1, SMALL))
    return tmp_path


def recipe(folder, *names, frames=34, **settings) -> evaluate.EvaluateRecipe:
    """An evaluation on two clips: of a second, which is one long command of each; 61 frames are two seconds."""
    settings = {"horizon": ("long",), **settings}
    runs = tuple(folder / name for name in names)
    return evaluate.EvaluateRecipe(runs=runs, motions=(write_motions(folder, frames),), device="cpu", **settings)


def test_every_policy_at_every_horizon(runs, capsys):
    scores = evaluate.main(
        recipe(runs, "plain", "far-sighted", horizon=("long", "single"), csv=runs / "scores.csv", frames=61)
    )
    cells = [("plain", "long"), ("far-sighted", "long"), ("plain", "single"), ("far-sighted", "single")]
    assert [(score.policy, score.horizon) for score in scores] == cells
    assert [len(score.records[0].clip) for score in scores[::2]] == [4, 200]
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "2 motions, 4 s; 95 % intervals over motions in parentheses, too narrow over so few"
    assert len(printed) == 2 + 4 + 2
    assert printed[-1] == f"wrote {runs / 'scores.csv'}"
    with (runs / "scores.csv").open(newline="") as file:
        assert {(row["policy"], row["horizon"]) for row in csv.DictReader(file)} == set(cells)


@pytest.mark.parametrize("read", ["families.csv", "families_authored.csv"])
def test_scores_do_not_replace_a_table_that_is_read(runs, read):
    (runs / read).write_text("clip,family\nrun,fast\n")
    settings = recipe(runs, "plain", manifest=(runs / read,), csv=runs / "families.csv")
    with pytest.raises(OutputError, match=f"--csv: would replace .*{read}', which is read"):
        evaluate.main(settings)
    write_csv(runs / "walk.csv", bowing_clip())
    with pytest.raises(OutputError, match=r"--csv: would replace .*walk.csv', which is read"):
        evaluate.main(replace(settings, csv=runs / "walk.csv", motions=(str(runs),)))
    assert (runs / read).read_text() == "clip,family\nrun,fast\n"


def test_folders_of_motions_are_searched_once(runs, monkeypatch):
    """Once they are in the cache."""
    searched: list[object] = []
    search = files.find_files
    monkeypatch.setattr(files, "find_files", lambda *names, **how: searched.append(names) or search(*names, **how))
    monkeypatch.setattr(evaluate, "run_study", lambda *_, **__: Study())
    settings = recipe(runs, "plain", csv=runs / "new.csv")
    evaluate.main(settings)
    searched.clear()
    evaluate.main(settings)
    assert len(searched) == 1


def test_only_some_motions(runs, capsys):
    (score,) = evaluate.main(recipe(runs, "plain", only="run", frames=61))
    assert score.records[0].clip.unique().tolist() == [0]
    assert capsys.readouterr().out.startswith("1 motion, 2 s; intervals over one motion say nothing of others")


def test_what_a_robot_meets(runs):
    scores = [
        evaluate.main(recipe(runs, "plain", frames=61, **more))[0]
        for more in ({}, {"disturbed": 1.0}, {"disturbed": 0.5})
    ]
    errors = [score.figures["mpkpe"].value for score in scores]
    assert len(set(errors)) == 3
    with pytest.raises(PlatError, match="--disturbed"):
        evaluate.main(recipe(runs, "plain", disturbed=1.0, domain_randomization=True))


@pytest.mark.parametrize(
    ("own", "told"),
    [
        ({}, ""),
        ({"dense": True}, "dense reference"),
        ({"disturbed": 0.5, "only": "run"}, "disturbed 0.5, only run"),
        ({"domain_randomization": True}, "domain randomization"),
        ({"interface": ("cascade",)}, "interface cascade"),
    ],
)
def test_tables_say_what_conditions_they_are_of(runs, tmp_path, own, told):
    policy = "expert" if "interface" in own else "plain"
    evaluate.main(recipe(runs, policy, csv=tmp_path / "scores.csv", out=tmp_path / "all", **own))
    header, first, *_ = (tmp_path / "scores.csv").read_text().splitlines()
    page = (tmp_path / "all" / "scores.md").read_text()
    assert (tmp_path / "all" / "scores.csv").read_text() == (tmp_path / "scores.csv").read_text()
    if not told:
        assert header.endswith(",high")
        assert "Conditions" not in page
        return
    assert header.endswith(",high,conditions")
    assert first.endswith((f',"{told}"', f",{told}"))
    assert page.startswith(f"Conditions: {told}.\n")


@pytest.mark.parametrize(("name", "dense"), [("plain", False), ("expert", True)])
def test_an_interface_that_nothing_is_told_by_is_refused(runs, name, dense):
    with pytest.raises(PlatError, match="--interface: takes effect only with a dense tracker and no --dense"):
        evaluate.main(recipe(runs, name, interface=("line",), dense=dense))


def test_another_arrival_window_is_a_condition(runs, tmp_path, capsys):
    save_run(runs / "patient", PlainPolicy(G1, replace(SMALL, timing=Timing(window=5))))
    evaluate.main(recipe(runs, "patient", csv=tmp_path / "scores.csv"))
    told = "arrival window of 5 control steps, not 3"
    assert f"conditions: {told}\n" in capsys.readouterr().out
    assert (tmp_path / "scores.csv").read_text().splitlines()[1].endswith(f'"{told}"')


def test_dense_goals_of_an_expert_that_sees_several_frames(runs, monkeypatch):
    seen = {}

    def record(policy, library, horizon, setting, **view):
        seen.update(view, keys=set(policy.in_keys))
        return original(policy, library, horizon, setting, **view)

    original = entrant.evaluate
    monkeypatch.setattr(entrant, "evaluate", record)
    evaluate.main(recipe(runs, "far-sighted", dense=True))
    assert seen["dense"] is True
    assert seen["goals"] == {"goal": 1, "goal_6": 6}
    assert ("goal_6", "joint_pos") in seen["keys"]
    motion = evaluate.MotionLibrary.load(write_motions(runs)).only(0)
    dense = evaluate.Entrant.of_run(runs / "far-sighted", "cpu", dense=True)
    assert len(dense.play(motion, HORIZONS["long"]).qpos) > 10  # a film strip shows the same
    evaluate.main(recipe(runs, "far-sighted"))
    assert ("goal_6", "joint_pos") not in seen["keys"]


def test_runs_of_the_same_name_are_told_apart(runs, capsys):
    save_run(runs / "other" / "plain", PlainPolicy(G1, SMALL))
    scores = evaluate.main(recipe(runs, "plain", "other/plain"))
    lines = capsys.readouterr().out.splitlines()
    assert [score.policy for score in scores] == [str(runs / "plain"), str(runs / "other" / "plain")]
    assert [line.split()[:2] for line in lines[2:4]] == [[score.policy, "long"] for score in scores]  # however long


def test_figures_are_drawn(runs, capsys):
    pytest.importorskip("matplotlib")
    folder = runs / "figures"
    folder.mkdir()
    (folder / "bars_single.png").touch()  # of an earlier start
    evaluate.main(
        recipe(runs, "plain", "expert", horizon=("short", "long", "mixed"), figures=folder, clip="walk", frames=40)
    )
    drawn = {path.name for path in folder.iterdir()}
    stems = {"radar", "bars_short", "bars_long", "bars_mixed", "success"}
    if "no film strip" not in capsys.readouterr().out:  # a machine without OpenGL says so
        stems.add("film_strip")
    assert drawn == {f"{stem}.{kind}" for stem in stems for kind in ("pdf", "png")}


def test_two_horizons_make_no_radar_plot(runs):
    pytest.importorskip("matplotlib")
    scores = evaluate.main(recipe(runs, "plain", horizon=("single",)))
    assert {path.stem for path in evaluate.draw_scores(runs / "figures", scores)} == {"bars_single", "success"}


@pytest.mark.parametrize(
    ("horizons", "shown"),
    [(("mixed", "long", "short"), "long"), (("short", "medium"), "medium"), (("mixed",), "mixed")],
)
def test_a_strip_shows_the_commands_that_were_scored(runs, monkeypatch, horizons, shown):
    """Those of a motion depend on its number, and motions before it are too short for some horizons."""
    pytest.importorskip("matplotlib")
    played = {}
    monkeypatch.setattr(evaluate, "Stage", lambda *_, **__: nullcontext())
    monkeypatch.setattr(evaluate, "film_strip", lambda _, playbacks: played.update(playbacks))
    monkeypatch.setattr(evaluate, "save_figure", lambda *_: [])
    save_run(runs / "quick", PlainPolicy(G1, replace(SMALL, timing=Timing(max_steps=50))))
    clips = [standing_clip(name, frames) for name, frames in (("a", 90), ("b", 6), ("c", 100), ("d", 110))]
    save_motions(runs / "four.npz", clips)
    settings = recipe(runs, "plain", "quick", horizon=horizons, seed=3, figures=runs / "figures", clip="d")
    scores = evaluate.main(replace(settings, motions=(str(runs / "four.npz"),)))
    assert list(played) == ["plain", "quick"]
    for score in scores:
        if score.horizon == shown:
            records = score.records[0]
            scored = records.of_clips([int(records.clip.max())])
            playback = played[score.policy]
            begins = np.flatnonzero(np.append(True, (playback.steps_left <= 1) | playback.failed)[:-1])
            assert playback.command_length[begins].tolist() == scored.length.tolist()
            ended = np.append(begins[1:], len(playback.failed)) - 1
            assert playback.failed[ended].tolist() == scored.failed.tolist()


def test_a_strip_of_another_test_is_left_out(runs, capsys):
    pytest.importorskip("matplotlib")
    evaluate.main(recipe(runs, "plain", horizon=("single",), figures=runs / "disturbed", disturbed=0.5))
    assert "no film strip: it shows whole keyframes and an undisturbed robot" in capsys.readouterr().out


def test_a_motion_too_short_for_a_strip_is_named(runs, capsys):
    library = evaluate.MotionLibrary.load(recipe(runs, "plain").motions)
    library.clip_length[1] = 20
    entrants = {"plain": evaluate.Entrant.of_run(runs / "plain")}
    assert evaluate.draw_strips(runs, entrants, library, 1, ("single", "long"), 0, "cpu") == []
    assert "no film strip: motion 'walk_b' is shorter than a long command" in capsys.readouterr().out


@pytest.mark.parametrize("drawn", [{"figures": "figures"}, {"strips": "strips", "authored": 1}])
def test_a_missing_extra_is_said_before_the_evaluation(runs, monkeypatch, drawn):
    settings = {name: runs / value if isinstance(value, str) else value for name, value in drawn.items()}
    monkeypatch.setattr(entrant, "evaluate", lambda *_, **__: pytest.fail("evaluated first"))
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(PlatError, match=r"pip install 'plat-rl\[figures\]'"):
        evaluate.main(recipe(runs, "plain", **settings))
    (runs / next(iter(drawn))).write_text("in the way")
    with pytest.raises(PlatError, match=f"--{next(iter(drawn))} .*: is a file, expected a folder"):
        evaluate.main(recipe(runs, "plain", **settings))


def test_strips_of_authored_keyframes_are_named(runs, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(evaluate, "draw_authored_strips", lambda recipe, folder, *_: [folder / "authored_hold.png"])
    monkeypatch.setattr(evaluate, "score_authored", lambda *_: [])
    evaluate.main(recipe(runs, "plain", authored=1, strips=runs / "strips"))
    assert capsys.readouterr().out.splitlines()[-1] == f"wrote {runs / 'strips' / 'authored_hold.png'}"


def test_a_clip_that_is_not_there_is_named_before_the_evaluation(runs, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(entrant, "evaluate", lambda *_, **__: pytest.fail("evaluated first"))
    with pytest.raises(MotionError, match="'jump' is in none of the 2"):
        evaluate.main(recipe(runs, "plain", figures=runs / "figures", clip="jump"))


def test_released_trackers_take_part(runs, shared_data):
    pytest.importorskip("onnxruntime")
    trackers = ReleasedTrackers(twist2=shared_data / "baselines" / "twist2" / "twist2_1017_20k.onnx")
    plain, twist2 = evaluate.main(recipe(runs, "plain", trackers=trackers, frames=61))
    assert twist2.policy == "TWIST2"
    assert plain.records[0].length.equal(twist2.records[0].length)  # the same commands
    assert twist2.figures["tks"].value > 50


def test_nothing_to_evaluate(tmp_path):
    with pytest.raises(PlatError, match="nothing to evaluate"):
        evaluate.main(recipe(tmp_path))


def test_the_table_goes_to_wandb(runs, monkeypatch):
    pytest.importorskip("wandb")
    monkeypatch.chdir(runs)
    evaluate.main(recipe(runs, "plain", wandb=True))
    assert list((runs / "wandb").glob("offline-run-*"))


def test_authored_keyframes_have_a_table_of_their_own(runs, capsys, tmp_path):
    evaluate.main(recipe(runs, "plain", authored=1, only="run", csv=tmp_path / "scores.csv", pushes=0.2))
    assert (tmp_path / "scores.csv").exists()
    header, *rows = (tmp_path / "scores_authored.csv").read_text().splitlines()
    assert header.endswith(",high,conditions")
    assert all(row.endswith(',"only run, pushes of 0.2 m/s every 1.5 s"') for row in rows)
    assert any(row.startswith("plain,far,1,reached,") for row in rows)
    printed = capsys.readouterr().out
    assert "plain, authored keyframes, pushes of 0.2 m/s every 1.5 s" in printed
    table = printed[printed.index("| family") :]
    families = [line.split("|")[1].strip() for line in table.splitlines()[2:] if line.startswith("|")]
    # nobody rests in a run, and a policy of 1 s has no 3 s
    assert families == ["arms", "steps", "crouch", "reach", "three_point", "waypoint", "far"]


@pytest.fixture
def made_up(monkeypatch):
    """Authored keyframes of one chain and made-up records of them, which take seconds otherwise."""
    monkeypatch.setattr(authored_cells, "author_families", lambda *_: author("far", G1, 1, seed=0))
    monkeypatch.setattr(authored_cells, "evaluate_authored", lambda *_, **__: authored_records())


def test_authored_keyframes_are_among_the_tables_of_a_folder(runs, tmp_path, made_up):
    evaluate.main(recipe(runs, "plain", authored=1, only="run", out=tmp_path / "all"))
    assert "plain,far,2,reached," in (tmp_path / "all" / "scores_authored.csv").read_text()
    page = (tmp_path / "all" / "scores.md").read_text()
    assert page.index("TKS@3") < page.index("plain, authored keyframes\n\n| family")


def test_authored_keyframes_of_an_earlier_start_are_kept(runs, capsys, tmp_path, monkeypatch, made_up):
    authored = recipe(runs, "plain", authored=1, only="run", out=tmp_path)
    evaluate.main(authored)
    monkeypatch.setattr(authored_cells, "evaluate_authored", lambda *_, **__: pytest.fail("evaluated again"))
    before = capsys.readouterr().out
    evaluate.main(authored)
    table = before.index("plain, authored keyframes")
    assert before[table:] in capsys.readouterr().out


def test_one_evaluation_at_a_time_writes_into_a_folder(runs, tmp_path):
    settings = recipe(runs, "plain", only="run", out=tmp_path / "all")
    (tmp_path / "all" / "records").mkdir(parents=True)
    with (tmp_path / "all" / "records" / LOCK_FILE).open("a+") as file:
        lock_file(file)  # as another process would
        with pytest.raises(CheckpointError, match="all/records': process unknown is writing into it; wait until it"):
            evaluate.main(settings)
    evaluate.main(settings)
    assert (tmp_path / "all" / "scores.csv").exists()


def test_tables_of_an_earlier_start_do_not_stay(runs, tmp_path, made_up):
    out = tmp_path / "all"
    evaluate.main(recipe(runs, "plain", authored=1, only="run", out=out))
    assert {path.name for path in out.iterdir()} == {"records", "scores.csv", "scores.md", "scores_authored.csv"}
    evaluate.main(recipe(runs, "plain", only="run", seed=3, out=out))
    assert {path.name for path in out.iterdir()} == {"records", "scores.csv", "scores.md"}


def test_tables_of_other_rows_are_told_before_they_are_replaced(runs, tmp_path, capsys):
    out = tmp_path / "all"
    evaluate.main(recipe(runs, "plain", horizon=("long", "single"), out=out))
    evaluate.main(recipe(runs, "plain", horizon=("long", "single"), out=out))
    assert "replaced" not in capsys.readouterr().out
    evaluate.main(recipe(runs, "far-sighted", horizon=("long",), out=out))
    told = f"tables in {str(out)!r} are replaced, which were of plain at long, single: their records stay\n"
    assert told in capsys.readouterr().out


@pytest.mark.parametrize("name", ["s.csv", "s.tsv"])
def test_authored_keyframes_of_an_earlier_start_do_not_stay_beside_a_table(runs, tmp_path, made_up, name):
    csv, beside = tmp_path / name, tmp_path / name.replace("s.", "s_authored.")
    evaluate.main(recipe(runs, "plain", authored=1, only="run", csv=csv))
    assert beside.exists()
    (tmp_path / "s_mine.csv").touch()
    evaluate.main(recipe(runs, "plain", only="run", csv=csv))
    assert not beside.exists()
    assert (tmp_path / "s_mine.csv").exists()
    beside.write_text("policy,family,notes\n")  # not plat's
    evaluate.main(recipe(runs, "plain", only="run", csv=csv))
    assert beside.exists()


def test_a_table_of_tabs_has_tabs(runs, tmp_path, made_up):
    evaluate.main(recipe(runs, "plain", authored=1, only="run", csv=tmp_path / "s.tsv"))
    for name in ("s.tsv", "s_authored.tsv"):
        first, *_ = (tmp_path / name).read_text().splitlines()
        assert first.startswith("policy\t")
        assert "," not in first


@pytest.mark.parametrize("name", ["groups.csv", "scores_authored.csv"])
def test_a_table_of_a_folder_is_no_other_table(runs, tmp_path, name):
    with pytest.raises(OutputError, match=f"--csv '.*{name}': --out writes that file itself: give another name"):
        evaluate.main(recipe(runs, "plain", csv=tmp_path / name, out=tmp_path))


@pytest.mark.parametrize("name", ["scores.csv", "groups.csv", "scores_authored.csv"])
def test_a_folder_of_tables_does_not_replace_what_is_read(runs, tmp_path, name):
    (tmp_path / name).write_text("clip,family\nrun,fast\n")
    with pytest.raises(OutputError, match=f"--out: would replace .*{name}', which is read"):
        evaluate.main(recipe(runs, "plain", manifest=(tmp_path / name,), out=tmp_path))


def test_figures_of_an_earlier_start_do_not_stay(tmp_path):
    for name in ("radar.png", "radar.pdf", "bars_long.png", "success.png", "bars_mine.png", "photo.png"):
        (tmp_path / name).touch()
    evaluate.remove_figures(tmp_path, ["radar", "bars_long", "success", "film_strip"], [tmp_path / "success.png"])
    assert {path.name for path in tmp_path.iterdir()} == {"success.png", "bars_mine.png", "photo.png"}


def test_a_killed_evaluation_leaves_its_page(runs, tmp_path, monkeypatch, made_up):
    out, ended = tmp_path / "all", []
    evaluate.main(recipe(runs, "plain", authored=1, only="run", out=out))  # an earlier start, of other tables
    tell = evaluate.Teller.__call__

    def stop_after_one(teller, study):
        tell(teller, study)
        ended.append((out / "scores.md").read_text())
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate.Teller, "__call__", stop_after_one)
    settings = recipe(runs, "plain", "far-sighted", only="run", horizon=("long", "single"), seed=4, out=out)
    with pytest.raises(KeyboardInterrupt):
        evaluate.main(settings)
    assert {path.name for path in out.iterdir()} == {"records", "scores.csv", "scores.md"}
    told, _, head, _, row, *_ = ended[0].splitlines()
    assert told == "Conditions: only run."
    assert head.endswith("| long |")
    assert row.startswith("| plain | ")
    assert "far-sighted" not in ended[0]
    assert "authored" not in ended[0]
    monkeypatch.undo()
    evaluate.main(settings)
    _, _, head, _, *rows = (out / "scores.md").read_text().splitlines()
    assert head.endswith("| long | single |")
    assert [row.split(" | ")[0] for row in rows[:2]] == ["| plain", "| far-sighted"]


def test_authored_keyframes_are_on_the_page_as_they_come(runs, tmp_path, monkeypatch, made_up):
    pages = []

    def one_by_one(*args, **settings):
        for found in authored_cells.records_of_all(*args, **settings):
            yield found
            pages.append((tmp_path / "scores.md").read_text())

    monkeypatch.setattr(evaluate, "records_of_all", one_by_one)
    evaluate.main(recipe(runs, "plain", "far-sighted", authored=1, only="run", out=tmp_path))
    assert [page.count("authored keyframes\n\n| family") for page in pages] == [1, 2]


def test_a_policy_of_other_timing_is_scored_by_its_own(runs, capsys):
    save_run(runs / "slow", PlainPolicy(G1, replace(SMALL, timing=Timing(control_dt=0.04, max_steps=150))))
    (score,) = evaluate.main(recipe(runs, "slow", horizon=("all",), num_envs=2, frames=61))
    assert score.horizon == "all"
    assert int(score.records[0].length.sum()) == 2 * 50  # two clips of 2 s
    assert capsys.readouterr().out.startswith("2 motions, 4 s")


def test_commands_longer_than_a_policy_knows_are_refused(runs):
    save_run(runs / "far", PlainPolicy(G1, replace(SMALL, timing=Timing(max_steps=150))))
    told = "^plain: horizon 'distant': 150 control steps, expected at most the policy's 50"
    for names in (("plain",), ("far", "plain")):
        with pytest.raises(PlatError, match=told):
            evaluate.main(recipe(runs, *names, horizon=("distant",)))


def test_policies_of_different_timing_are_not_mixed(runs):
    save_run(runs / "slow", PlainPolicy(G1, replace(SMALL, timing=Timing(control_dt=0.04))))
    with pytest.raises(PlatError, match="different control steps: plain 0.02 s, slow 0.04 s"):
        evaluate.main(recipe(runs, "plain", "slow"))
    save_run(runs / "far", PlainPolicy(G1, replace(SMALL, timing=Timing(max_steps=150))))
    with pytest.raises(PlatError, match="horizon 'all': longest commands of plain 50, far 150 control steps"):
        evaluate.main(recipe(runs, "plain", "far", horizon=("all",)))
    save_run(runs / "patient", PlainPolicy(G1, replace(SMALL, timing=Timing(window=5))))
    with pytest.raises(PlatError, match="different arrival windows: plain 3, patient 5 control steps"):
        evaluate.main(recipe(runs, "plain", "patient"))


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ({"robustness": ("push",), "disturbed": 0.5}, "--robustness: .* expected no --disturbed"),
        ({"robustness": ("push",), "domain_randomization": True}, "--robustness: .* no --domain-randomization"),
        ({"authored": 1, "disturbed": 0.5}, "--authored: .* run --disturbed without --authored"),
        ({"authored": 1, "domain_randomization": True}, "--authored: .* run --domain-randomization without"),
        ({"authored": 1, "partial": "hands"}, "--authored: .* run --partial without --authored"),
        ({"authored": 1, "dense": True}, "--authored: .* run --dense without --authored"),
        ({"whole_clips": ("supermimic",), "partial": "hands"}, "--whole-clips: .* no --partial"),
        ({"pushes": 0.3}, "--pushes: .* --authored"),
        ({"strips": Path("strips")}, "--strips: .* --authored"),
        ({"clip": "walk"}, "--clip: .* --figures"),
        ({"randomization": RandomizationRanges(push_interval=(1.0, 2.0))}, "--randomization: .* --domain-random"),
    ],
)
def test_flags_that_mean_nothing_together_are_refused_before_anything_is_read(flags, told, tmp_path):
    settings = {"runs": (tmp_path / "none",), "motions": ("none.npz",), **flags}
    with pytest.raises(PlatError, match=told):
        evaluate.main(evaluate.EvaluateRecipe(device="cpu", **settings))
