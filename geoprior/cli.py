"""The command line: arguments in, one call, words out. No logic, and nothing heavy until it is needed."""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from geoprior import __version__
from geoprior.errors import GeopriorError
from geoprior.stages import STAGE_NAMES, STAGES, Stage

if TYPE_CHECKING:
    from geoprior.config import RunConfig

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
INTERRUPTED = 130
VERBOSE = "--verbose"
CONFIG_HELP = (
    "CONFIG is a YAML file or the name of a packaged config; without it, the config that the run folder "
    "holds, or else the quickstart."
)


def _say(text: str) -> None:
    click.echo(text, err=True)


@click.group(
    context_settings=CONTEXT,
    epilog="Exit codes: 0 done, 1 unforeseen, 2 wrong command line or config, 3 plug-in, 4 damaged or "
    "foreign file, 5 unfit machine, 6 numbers not finite, 130 interrupted (the same command goes on).",
)
@click.version_option(__version__, prog_name="geoprior")
@click.option(
    VERBOSE, is_flag=True, expose_value=False, help="Show tracebacks of errors; may stand anywhere."
)
def cli() -> None:
    """Give a robot policy a geometric prior, and measure what it was worth.

    \b
    The whole line on the packaged quickstart, then the page with the result:
      geoprior run --out runs/quickstart
      xdg-open runs/quickstart/report/index.html

    \b
    Change a key, and see what a config can say:
      geoprior run --out runs/more --set evaluate.trials=50
      geoprior config schema

    A run goes on where it was stopped when the same command is given again.
    """  # noqa: D301 - \b is click's mark for text that is not to be wrapped


def _run_options(function: Callable[..., None]) -> Callable[..., None]:
    options = [
        click.argument("config", required=False),
        click.option(
            "--out",
            type=click.Path(path_type=Path),
            required=True,
            help="The run folder; made if it is not there.",
        ),
        click.option(
            "--set",
            "overrides",
            metavar="KEY=VALUE",
            multiple=True,
            help="Override one key of the config; the value is YAML: --set generate.episodes=50, "
            "--set finetune.seeds=[0,1], --set robot=xarm7.",
        ),
        click.option("--replace", is_flag=True, help="Run stages whose config has changed again, in place."),
    ]
    for option in reversed(options):
        function = option(function)
    return function


@cli.command()
@_run_options
def run(config: str | None, out: Path, overrides: tuple[str, ...], replace: bool) -> None:  # noqa: FBT001
    """Run the whole line: generate, pretrain, demos, finetune, evaluate, report.

    CONFIG is a YAML file or the name of a packaged config; without it, the config that the run folder
    holds, or else the quickstart. Stages that are done are skipped; a stage that was stopped goes on.
    """
    from geoprior.pipeline import is_follower

    _run(config, out, overrides, STAGE_NAMES, replace=replace)
    if is_follower():
        return
    _say(_headline(out))
    _say(f"report: {out / 'report' / 'index.html'}")


def _stage_command(stage: Stage) -> click.Command:
    reads = f" It reads what {', '.join(stage.inputs)} wrote." if stage.inputs else ""

    @_run_options
    def command(config: str | None, out: Path, overrides: tuple[str, ...], replace: bool) -> None:  # noqa: FBT001
        _run(config, out, overrides, (stage.name,), replace=replace)

    help_text = (
        f"{stage.summary}\n\nOne stage of `geoprior run`, on the same run folder.{reads} "
        f"It writes {' and '.join(stage.outputs)}.\n\n{CONFIG_HELP}"
    )
    return click.command(stage.name, help=help_text, short_help=stage.summary)(command)


for _stage in STAGES:
    cli.add_command(_stage_command(_stage))


def _run(
    config: str | None, out: Path, overrides: tuple[str, ...], names: tuple[str, ...], *, replace: bool
) -> None:
    from geoprior.hooks.manager import plugins
    from geoprior.pipeline import follow_stages, interrupt_on_termination, is_follower, run_stages
    from geoprior.run_folder import open_run

    interrupt_on_termination()
    resolved = _load(config, overrides, out)
    if is_follower():
        follow_stages(resolved, out, names, plugins())
        return
    _ensure_fit(out, rendering=any(stage.simulates(resolved) for stage in STAGES if stage.name in names))
    with open_run(out, resolved, STAGES, replace=replace) as folder:
        run_stages(folder, names, plugins(), _say)


def _headline(out: Path) -> str:
    from geoprior.files import read_json
    from geoprior.run_folder import RUN_FILE

    return str(read_json(out / RUN_FILE)["stages"]["report"]["result"]["headline"])


def _load(config: str | None, overrides: tuple[str, ...], out: Path | None = None) -> RunConfig:
    from geoprior.config import QUICKSTART, load_config
    from geoprior.hooks.manager import plugins
    from geoprior.run_folder import saved_config

    saved = saved_config(out) if out is not None else None
    return load_config(config or saved or QUICKSTART, overrides, plugins())


def _ensure_fit(out: Path, *, rendering: bool) -> None:
    from geoprior.doctor import checks

    findings = checks.examine(out, rendering=rendering)
    checks.require_fit(findings)
    if not rendering:
        return
    os.environ[checks.GL_VARIABLE] = checks.usable_backend(findings)


@cli.command()
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
def doctor(as_json: bool) -> None:  # noqa: FBT001
    """Check this machine: versions, GL backends (each renders a frame), disk and cores.

    What is missing comes with the line that mends it. Ends with code 5 when a run could not work here.
    """
    from geoprior.doctor import checks

    simulates = checks.is_simulation_installed()
    findings = checks.examine(Path.cwd(), rendering=simulates)
    findings += [] if simulates else [checks.without_simulation()]
    if as_json:
        click.echo(json.dumps([vars(finding) for finding in findings], indent=2))
    else:
        for finding in findings:
            mark = "ok     " if finding.good else "MISSING" if finding.needed else "absent "
            click.echo(f"{mark} {finding.name}: {finding.text}")
            if finding.mend:
                click.echo(f"          {finding.mend}")
    checks.require_fit(findings)


@cli.group("plugins")
def plugins_group() -> None:
    """See what is installed: primitives, motions, variants, renderers, robots, tasks, looks, policies..."""


@plugins_group.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print the plug-ins and what they offer as JSON.")
def plugins_list(as_json: bool) -> None:  # noqa: FBT001
    """List every plug-in found and everything it registers.

    Plug-ins are found by the entry-point group `geoprior`. GEOPRIOR_PLUGINS=a,b allows only those: names of
    packages, or of single entry points.
    """
    from geoprior.hooks.listing import as_lines, as_tree
    from geoprior.hooks.manager import plugins

    found = plugins()
    click.echo(json.dumps(as_tree(found), indent=2) if as_json else "\n".join(as_lines(found)))


class _Kind(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.3 on
    """A kind of plug-in; the registry of hooks, which says which there are, is imported when asked."""

    name = "kind"

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        from geoprior.hooks.manager import HOOK_OF_KIND

        del param, ctx
        return f"[{'|'.join(HOOK_OF_KIND)}]"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        from geoprior.hooks.manager import HOOK_OF_KIND

        if value not in HOOK_OF_KIND:
            self.fail(f"{value!r} is no kind of plug-in; the kinds are {', '.join(HOOK_OF_KIND)}", param, ctx)
        return value


@plugins_group.command("show")
@click.argument("kind", type=_Kind())
@click.argument("name")
@click.option("--json", "as_json", is_flag=True, help="Print the JSON schema of the options.")
def plugins_show(kind: str, name: str, as_json: bool) -> None:  # noqa: FBT001
    """Explain the options of one plug-in: default, limits, meaning.

    \b
      geoprior plugins show policy act
      geoprior plugins show task pile
    In a config: `task: {name: pile, gap: 0.16}`; on the command line: --set task=pile --set task.gap=0.16
    """  # noqa: D301
    from geoprior.config_schema import option_lines
    from geoprior.hooks.manager import plugins

    spec = plugins().spec(kind, name)
    click.echo(
        json.dumps(spec.config.model_json_schema(), indent=2) if as_json else "\n".join(option_lines(spec))
    )


@plugins_group.command("new")
@click.argument("name")
@click.option("--kind", type=_Kind(), required=True, help="What the package shall add.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path(),
    show_default="the current folder",
    help="Where the package's folder goes.",
)
def plugins_new(name: str, kind: str, out: Path) -> None:
    """Write a package that adds a plug-in: small, working, with tests; change it into yours.

    NAME is what a config will call it: lower-case letters, digits and dashes. The package is geoprior-NAME.
    """
    from geoprior.authoring.scaffold.write import next_commands, write_package
    from geoprior.hooks.manager import plugins

    folder = write_package(name, kind, out, plugins())
    click.echo(f"{folder}: a package that adds the {kind} {folder.name.removeprefix('geoprior-')!r}. Next:")
    for command in next_commands(folder):
        click.echo(f"  {command}")


@plugins_group.command("check")
@click.argument("name")
@click.option("--quick", is_flag=True, help="Leave out what simulates or trains.")
@click.option("--json", "as_json", is_flag=True, help="Print every finding as JSON.")
def plugins_check(name: str, quick: bool, as_json: bool) -> None:  # noqa: FBT001
    """Check that an installed package keeps the contracts of what it offers. Ends with code 3 if not.

    NAME is that of a package or of one of its entry points; `geoprior` checks the built-ins.
    """
    from geoprior.authoring.conformance.command import check
    from geoprior.errors import PluginError
    from geoprior.hooks.manager import plugins

    content = check(name, plugins(), (lambda _: None) if as_json else click.echo, slow=not quick)
    if as_json:
        click.echo(json.dumps(content, indent=2))
    if content["failed"]:
        raise PluginError(
            f"{content['package']} {content['version']}: {content['failed']} of {content['checks']} failed",
            "below each stands what to do; docs/plugins.md has the contracts",
        )
    if not as_json:
        click.echo(f"{content['package']} {content['version']}: keeps all {content['checks']} checks")


@cli.group("config")
def config_group() -> None:
    """See what a config says and what it can say."""


@config_group.command("show")
@click.argument("config", required=False)
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override one key.")
def config_show(config: str | None, overrides: tuple[str, ...]) -> None:
    """Print a config resolved: extended, overridden, checked, every option written out.

    CONFIG is a YAML file or the name of a packaged config; the quickstart without it.
    """
    from geoprior.config import to_yaml

    click.echo(to_yaml(_load(config, overrides)), nl=False)


@config_group.command("schema")
def config_schema() -> None:
    """Print the JSON schema of a config, for editors: every key and every plug-in's options.

    `geoprior plugins show KIND NAME` says the same of one plug-in for reading.
    """
    from geoprior.config_schema import config_schema as schema
    from geoprior.hooks.manager import plugins

    click.echo(json.dumps(schema(plugins()), indent=2))


@cli.command()
@click.argument("episode")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path(),
    show_default="the current folder",
    help="Where the pictures go.",
)
@click.option(
    "--film",
    type=click.Choice(["webm", "mp4", "gif", "none"]),
    default="webm",
    show_default=True,
    help="Kind of the films.",
)
@click.option(
    "--set",
    "overrides",
    metavar="KEY=VALUE",
    multiple=True,
    help="Override one key of the config, if EPISODE is one's.",
)
@click.option("--3d", "space", is_flag=True, help="Draw it in 3-D too; so does each option below.")
@click.option("--azimuth", type=float, help="Look from this side, in degrees about z; 0 is +x.  [35]")
@click.option("--elevation", type=float, help="Look from so many degrees above the floor, -90 to 90.  [30]")
@click.option("--orbit", type=float, help="Go round by so many degrees in the course of the film.  [0]")
@click.option("--wide", is_flag=True, help="Have the whole floor and the third camera in the picture.")
def view(episode: str, out: Path, overrides: tuple[str, ...], **asked: Any) -> None:
    """Draw an episode: a contact sheet (PNG), a film, and both in 3-D from any angle.

    \b
    EPISODE is a folder of shards or one tar, and after a colon the episode's key; or a config, for
    an episode that is on no disk. Without a key it is the first one.
      geoprior view runs/quickstart/shards/synthetic:pick-000003
      geoprior view runs/quickstart/shards/demos --3d
      geoprior view quickstart:push-000004 --3d --orbit 360
      geoprior view my.yaml:place-000000 --azimuth -90 --elevation 10 --film gif

    \b
    See what a key of the config does before a data set is made of it:
      geoprior view quickstart:push-000004 --film none --set generate.scene.floor.spacing=[0.03,0.03]

    In 3-D a hand is drawn as its frame [right, up, forward] and its way, thick while the gripper is
    closed; a camera as its frustum. Points are drawn where the config that made them is at hand, boxes
    where the header alone tells of them.
    """  # noqa: D301
    from geoprior.subjects import find_subject
    from geoprior.view.command import Look, draw

    look = Look.of(**asked)
    subject = find_subject(episode, overrides, points=look.angle is not None)
    if subject.remark:
        _say(subject.remark)
    for path in draw(subject, out, look):
        click.echo(str(path))


@cli.group("shards")
def shards_group() -> None:
    """Inspect shards: what they hold, and whether they are whole."""


@shards_group.command("verify")
@click.argument("path", type=click.Path(path_type=Path))
def shards_verify(path: Path) -> None:
    """Check a folder of shards, or one tar, to the last byte. Ends with code 4 on any fault."""
    from geoprior.errors import DataError
    from geoprior.shards.verify import verify

    faults = list(verify(path))
    for fault in faults:
        click.echo(str(fault))
    if faults:
        count = "one fault" if len(faults) == 1 else f"{len(faults)} faults"
        raise DataError(f"{path}: {count}", "delete what is damaged and generate it again")
    click.echo(f"{path}: whole")


@shards_group.command("info")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON.")
def shards_info(path: Path, as_json: bool) -> None:  # noqa: FBT001
    """Say what a folder of shards, or one tar, holds."""
    from geoprior.shards.verify import info

    content: dict[str, Any] = info(path)
    if as_json:
        click.echo(json.dumps(content, indent=2))
    else:
        for key, value in content.items():
            click.echo(f"{key}: {value}")


@shards_group.command("preview")
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The picture (PNG).  [PATH's name in the current folder]",
)
@click.option("--rows", type=click.IntRange(1, 200), default=9, show_default=True, help="Episodes shown.")
@click.option(
    "--columns", type=click.IntRange(1, 50), default=5, show_default=True, help="Steps shown of each camera."
)
def shards_preview(path: Path, out: Path | None, rows: int, columns: int) -> None:
    """Draw a sheet of a folder of shards, or of one tar: some episodes, the motions in turn.

    \b
      geoprior shards preview runs/quickstart/shards/synthetic
      geoprior shards preview runs/quickstart/shards/demos --rows 20 --columns 8 --out demos.png
    """  # noqa: D301
    from geoprior.view.command import preview

    click.echo(str(preview(path, out, rows, columns)))


@cli.group("export")
def export_group() -> None:
    """Give a checkpoint to other software."""


@export_group.command("lerobot-policy")
@click.argument("checkpoint", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="A folder that is new or empty.")
@click.option(
    "--execute", type=int, help="Actions of a chunk before LeRobot looks again; all of them by default."
)
@click.option(
    "--ensembling",
    type=float,
    help="Coefficient of temporal ensembling, for which LeRobot looks at each step.",
)
def export_lerobot_policy(checkpoint: Path, out: Path, execute: int | None, ensembling: float | None) -> None:
    """Write a checkpoint of ACT as a folder that LeRobot 0.4.4's ACTPolicy.from_pretrained loads.

    \b
      geoprior export lerobot-policy runs/quickstart/checkpoints/finetune/prior-s0/epoch-000192.safetensors \\
        --out exported

    With it go LeRobot's pre- and post-processors, and observations with the actions that geoprior says to
    them: benchmarks/check_lerobot_export.py compares, where LeRobot is installed.
    """  # noqa: D301
    from geoprior.policies.export_lerobot import export_lerobot

    for path in export_lerobot(checkpoint, out, execute, ensembling):
        click.echo(str(path))


@export_group.command("onnx")
@click.argument("checkpoint", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="The file; one that is there is replaced.",
)
def export_onnx_file(checkpoint: Path, out: Path) -> None:
    """Write a checkpoint of any policy as one ONNX file that onnxruntime runs alone.

    \b
      pip install 'geoprior[onnx]'
      geoprior export onnx runs/quickstart/checkpoints/finetune/prior-s0/epoch-000192.safetensors \\
        --out policy.onnx

    It takes a batch of raw observations: `pose` (B, 8 x hands) float32, and each camera by its name, (B,
    height, width, 3) uint8 RGB; a binary frame is repeated to three channels. It gives `action` (B, chunk, 8
    x hands) float32, ready for the arm: unit quaternions, gripper 0 or 1. The file's property `geoprior`
    says rate, cameras, units and fields in JSON. Where onnxruntime is installed, the actions are compared
    with geoprior's before anything is written.
    """  # noqa: D301
    from geoprior.policies.export_onnx import export_onnx

    done = export_onnx(checkpoint, out)
    checked = "not compared: onnxruntime is not installed"
    if done.deviation is not None:
        checked = f"under onnxruntime its actions differ from geoprior's by {done.deviation:.1e} at most"
    _say(checked)
    click.echo(str(done.path))


@cli.command()
@click.argument("checkpoint", type=click.Path(path_type=Path))
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Measure on these episodes: a folder of shards, or one tar.  [what its run says]",
)
@click.option("--episodes", type=click.IntRange(2, 100_000), help="Of each motion, at most.  [100]")
@click.option("--states", type=click.IntRange(2, 100_000), help="Initial states to aim on.  [160]")
@click.option("--no-aim", is_flag=True, help="Leave the aim error out, which simulates.")
@click.option("--json", "as_json", is_flag=True, help="Print one object: motions, aim, linear_probe_cm.")
def probe(
    checkpoint: Path,
    data: Path | None,
    episodes: int | None,
    states: int | None,
    no_aim: bool,  # noqa: FBT001
    as_json: bool,  # noqa: FBT001
) -> None:
    """Measure whether a policy looks: its error with the right images, with others' and with none.

    \b
      geoprior probe runs/quickstart/checkpoints/pretrain/epoch-000060.safetensors
      geoprior probe runs/quickstart/checkpoints/finetune/prior-s0/epoch-000192.safetensors --json

    The errors are the normalised L1 of the predicted chunk on episodes that no training saw: with true
    images, with images shuffled among the episodes of a motion, with black ones; beside them those of
    standing still and of a regression on the pose alone. The vision gain is shuffled less true, with its
    standard error over the episodes. The aim error is the distance, seen from above, from the chunk's end to
    the object on unseen initial states of the run's robot and task. The linear probe says how well the
    object's place in those images (without an aim error: in the episodes') can be read from the features of
    the visual trunk by a linear map.
    """  # noqa: D301
    from geoprior.probing import EPISODES, STATES, Wanted, probe_checkpoint

    wanted = Wanted(data, episodes or EPISODES, 0 if no_aim else states or STATES)
    found = probe_checkpoint(checkpoint, wanted)
    if not as_json:
        click.echo("\n".join(found.as_lines()))
        return
    for remark in found.remarks:
        _say(remark)
    click.echo(json.dumps(found.as_tree(), indent=2))


def main() -> None:
    """The console script: `cli` with every error as a sentence and an exit code."""
    arguments = [argument for argument in sys.argv[1:] if argument != VERBOSE]
    verbose = len(arguments) < len(sys.argv) - 1
    try:
        code = cli(arguments, standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        _say("interrupted; what is finished is kept, and the same command goes on from there")
        sys.exit(INTERRUPTED)
    except GeopriorError as error:
        _complain(error, error.message, error.hint, verbose=verbose)
        sys.exit(error.exit_code)
    except Exception as error:  # noqa: BLE001 - the last door before the user
        known = _named_after_its_plugin(error)
        _complain(error, known.message, known.hint, verbose=verbose)
        sys.exit(known.exit_code)
    sys.exit(code if isinstance(code, int) else 0)


def _named_after_its_plugin(error: Exception) -> GeopriorError:
    """What nobody foresaw, as an error of the plug-in that raised it, or of ours."""
    from geoprior.hooks.failures import blamed
    from geoprior.hooks.manager import GROUP, plugins

    try:
        strangers = [plugin for plugin in plugins().found if plugin.package != GROUP]
    except GeopriorError:
        strangers = []
    hint = "this is a defect of geoprior or of a plug-in; add --verbose to see where"
    ours = GeopriorError(f"unforeseen {type(error).__name__}: {error}", hint)
    return blamed(error, strangers) or ours


def _complain(error: BaseException, message: str, hint: str, *, verbose: bool) -> None:
    if verbose:
        _say("".join(traceback.format_exception(error)))
    _say(f"error: {message}")
    if hint:
        _say(f"  hint: {hint}")


if __name__ == "__main__":
    main()
