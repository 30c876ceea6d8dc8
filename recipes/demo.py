"""All three stages and the evaluation at a small scale, on motions that plat makes itself; then the committed PLAT.

plat demo

Killed at any moment, it goes on where it was when it is started again: from the last checkpoint of a stage, 15 seconds
ago at most, or with what is missing of the evaluation.
"""

import time
from dataclasses import replace
from pathlib import Path

import plat.headless  # noqa: F401

# isort: split
from plat.cli import evaluate
from plat.cli import play as play_recipe
from plat.cli.settings import parse
from plat.control import distance_text, error_text
from plat.envs.transforms import PAPER_HORIZONS
from plat.errors import CheckpointError
from plat.evaluation import HEADLINE, Score, play
from plat.files import check_folder, clear_parts
from plat.modules import LatentPolicyConfig
from plat.motions import MotionLibrary
from plat.recipes import distill, expert_model, refine_model
from plat.recipes.options import DemoRecipe
from plat.rendering import RenderingError, Stage, contact_sheet, film_with_progress, write_picture, write_video
from plat.runs import SavedRun, is_run, load_policy, report_errors
from plat.runs.shipped import shipped_runs
from plat.tasks import TimedKeyframesConfig
from plat.words import percent

# what can be learned in a few minutes
FAMILIES = "stand+reach+walk+squat+wave+bow+step"
SAVE_EVERY = 15.0
"""Seconds between checkpoints; stages take one to four minutes."""
EXAMPLE = Path(__file__).parent / "examples" / "bow.json"
NAMES = {"expert": "expert as sparse policy", "dagger": "DAgger", "plat": "PLAT"}


def main(recipe: DemoRecipe) -> None:
    """Run the demo."""
    began = time.monotonic()
    check_folder(recipe.out)
    check_minutes(recipe)
    clear_parts(recipe.out)
    motions, out = (f"generated:train/{FAMILIES}",), recipe.out
    minutes = recipe.expert_minutes + recipe.distill_minutes + recipe.refine_minutes
    print(f"plat demo: {minutes:.1f} minutes of training, then about two of evaluation and pictures; no network needed")

    print("\n1/5  expert: follows the reference frame by frame, trained in a learned model of the robot", flush=True)
    expert_model.main(
        expert_model.ExpertModelRecipe(
            motions=motions,
            out=out / "expert",
            minutes=recipe.expert_minutes,
            save_every=SAVE_EVERY,
            num_envs=recipe.num_envs,
            seed=recipe.seed,
            resume=is_run(out / "expert"),
        )
    )
    print("\n2/5  DAgger: a student that sees keyframes only learns from the expert", flush=True)
    distill.main(
        distill.DistillRecipe(
            motions=motions,
            expert=out / "expert",
            policy=LatentPolicyConfig(symmetric=True),  # costs no training time, and is nearer
            out=out / "dagger",
            minutes=recipe.distill_minutes,
            save_every=SAVE_EVERY,
            num_envs=recipe.num_envs,
            seed=recipe.seed,
            resume=is_run(out / "dagger"),
        )
    )
    print("\n3/5  PLAT: a residual in the student's latent, trained in the same model", flush=True)
    refine_model.main(
        refine_model.RefineModelRecipe(
            motions=motions,
            student=out / "dagger",
            init_model=out / "expert",
            task=TimedKeyframesConfig(authored=0.0),  # scored on motions alone
            out=out / "plat",
            minutes=recipe.refine_minutes,
            save_every=SAVE_EVERY,
            num_envs=recipe.num_envs,
            seed=recipe.seed,
            resume=is_run(out / "plat"),
        )
    )
    print("\n4/5  evaluation on generated motions that training did not see", flush=True)
    rows = evaluate.main(
        evaluate.EvaluateRecipe(
            runs=tuple(out / name for name in NAMES),
            motions=(f"generated:val/{FAMILIES}",),
            csv=out / "evaluation.csv",
            out=out / "evaluation",  # keeps what is done
        )
    )
    pictures = draw(out)
    print_table(rows)
    print("\n5/5  the PLAT that comes with plat, trained for hours, chases a file of keyframes", flush=True)
    film_of_shipped = play_shipped(out)
    print(f"\ncheckpoints and curves   {out}/{{expert,dagger,plat}}/ (model.safetensors, metrics.csv)")
    print(f"all figures              {out / 'evaluation.csv'}")
    print(pictures)
    print(film_of_shipped)
    print(f"done in {(time.monotonic() - began) / 60:.1f} minutes; start it again to draw again, or remove {out} first")


def check_minutes(recipe: DemoRecipe) -> None:
    """Check that no stage would train on whose weights a later one has learned from: that one could not go on.

    Raises:
        CheckpointError: naming both.
    """
    minutes = {"expert": recipe.expert_minutes, "dagger": recipe.distill_minutes, "plat": recipe.refine_minutes}
    for place, (name, wanted) in enumerate(minutes.items(), 1):
        run = recipe.out / name
        trained = SavedRun(run).seconds if is_run(run) else 0.0
        later = [other for other in list(minutes)[place:] if (recipe.out / other / "model.safetensors").exists()]
        if later and trained < 60 * wanted:
            had = f"after {trained // 0.6 / 100:g}" if trained else "as it was"  # rounded down
            raise CheckpointError(
                f"{str(recipe.out)!r}: {name} would train to {wanted:g} minutes, and {later[0]} was made from it {had}"
                ": give another --out, or the minutes it had"
            )


def draw(out: Path) -> str:
    """Write contact sheet and video; where this machine cannot draw, say what to install."""
    library = MotionLibrary.load(f"generated:val/{FAMILIES}")
    clips = [library.clip_names.index(f"{family}_val_000") for family in ("walk", "reach", "squat")]
    policy = load_policy(out / "plat").deployed()
    playbacks = [play(policy, library, clip, PAPER_HORIZONS["long"]) for clip in clips]
    sheet, video = out / "contact_sheet.png", out / "plat.mp4"
    try:
        stage = Stage(library.robot, width=480, height=360)
        write_picture(sheet, contact_sheet(stage, playbacks))
        write_video(video, film_with_progress(stage, playbacks))
        stage.close()
    except RenderingError as error:
        return f"no pictures: {error}"
    return f"contact sheet            {sheet}\nvideo                    {video} (the ghost is the commanded keyframe)"


def play_shipped(out: Path) -> str:
    """Let the committed PLAT chase an example and print its scores, film it if one can."""
    recipe = play_recipe.PlayRecipe(policy=shipped_runs()["plat-g1"], keyframes=EXAMPLE, video=out / "shipped_plat.mp4")
    try:
        play_recipe.main(recipe)
    except RenderingError as error:  # known before the robot runs
        play_recipe.main(replace(recipe, video=None))
        return f"shipped PLAT             no video: {error}"
    return f"video of shipped PLAT    {recipe.video}"


def print_table(scores: list[Score]) -> None:
    """TKS@3 (%) / MPJPE@3 (rad) / MPKPE@3 (mm) of each policy at each horizon."""
    cells = {(score.policy, score.horizon): score.figures for score in scores}
    print(f"\n{'TKS@3 / MPJPE@3 / MPKPE@3':<26}" + "".join(f"{name:<22}" for name in PAPER_HORIZONS))
    for run, name in NAMES.items():
        line = f"{name:<26}"
        for horizon in PAPER_HORIZONS:
            tks, mpjpe, mpkpe = (cells[run, horizon][key].value for key in HEADLINE)
            line += f"{f'{percent(tks)} / {error_text(mpjpe)} / {distance_text(mpkpe)}':<22}"
        print(line)


if __name__ == "__main__":
    with report_errors():
        main(parse(DemoRecipe))
