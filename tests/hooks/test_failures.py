"""What a broken plug-in does to a run: it is named with package, version and hook, and others run on."""

import logging
import textwrap

import pytest
from command_line import geoprior
from hook_material import install

from geoprior import PrimitiveSpec, TrainStep, __version__, hookimpl
from geoprior.authoring.conformance.command import check
from geoprior.errors import ConfigError, NumericalError, PluginError
from geoprior.hooks.manager import Plugins
from geoprior.options import Choice, Options

WHO = "plug-in 'mug' of package 'geoprior-mug' 1.2"
SMALL = (
    "--set", "generate.primitives=[sphere]",
    "--set", "generate.episodes=1",
    "--set", "generate.seconds=1",
    "--set", "executor=serial",
)  # fmt: skip


class MugOptions(Options):
    size: float = 1.0


class Module:
    """A plug-in from functions, each marked as a hook."""

    def __init__(self, **hooks):
        for name, hook in hooks.items():
            hook.__name__ = name
            setattr(self, name, hookimpl(hook))


def registered(module, package="geoprior-mug"):
    plugins = Plugins()
    plugins.register(module, name="mug", package=package, version="1.2")
    return plugins


def offering(factory=lambda config: config, config=MugOptions):
    spec = PrimitiveSpec("mug", "a mug", config, factory)
    return Module(geoprior_primitives=lambda: [spec])


def step():
    return TrainStep("pretrain", 1, 2, 0.5, {"loss": 1.0}, None)


def fault_of(register_hook):
    with pytest.raises(PluginError) as caught:
        registered(Module(geoprior_primitives=register_hook))
    assert caught.value.message.startswith(f"{WHO}: geoprior_primitives ")
    assert "pip uninstall geoprior-mug" in caught.value.hint
    return caught.value


def test_a_register_hook_that_raises_is_named_with_the_place():
    def raising():
        raise RuntimeError("no licence\nfor this machine")

    fault = fault_of(raising)
    assert "raised RuntimeError: no licence (test_failures.py, line " in fault.message
    assert "a defect of that package" in fault.hint


def test_a_generator_that_raises_after_its_first_spec_leaves_nothing_behind():
    def raising():
        yield PrimitiveSpec("mug", "a mug", MugOptions, lambda config: config)
        raise RuntimeError("no more")

    plugins = Plugins()
    with pytest.raises(PluginError, match="no more"):
        plugins.register(
            Module(geoprior_primitives=raising), name="mug", package="geoprior-mug", version="1.2"
        )
    assert plugins.names("primitive") == ()
    assert plugins.found == ()


def test_a_spec_with_an_argument_too_few_or_too_many_is_of_another_version():
    for wrong in ({"name": "mug"}, {"name": "mug", "summary": "", "config": MugOptions, "colour": "red"}):
        fault = fault_of(lambda wrong=wrong: [PrimitiveSpec(**wrong)])
        assert "TypeError" in fault.message
        assert "written for another geoprior than" in fault.hint


def test_a_spec_of_an_unknown_type_is_named():
    class MugSpec:
        name, kind = "mug", "primitive"

    assert "yielded MugSpec, expected PrimitiveSpec" in fault_of(lambda: [MugSpec()]).message


def test_a_spec_that_lacks_an_attribute_is_named():
    class Bare(PrimitiveSpec):
        def __init__(self):
            object.__setattr__(self, "name", "mug")

    assert "without the attribute 'summary'" in fault_of(lambda: [Bare()]).message


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        (("Mug", "", MugOptions, print), "lower-case letters"),
        (("mug", None, MugOptions, print), "no text"),
        (("mug", "", dict, print), "no pydantic model"),
        (("mug", "", MugOptions, "print"), "cannot be called"),
    ],
)
def test_a_spec_that_is_not_whole_is_refused_at_the_door(values, complaint):
    assert complaint in fault_of(lambda: [PrimitiveSpec(*values)]).message


def test_a_register_hook_that_ends_the_process_is_named_and_leaves_nothing():
    def leaving():
        raise SystemExit(4)

    assert "raised SystemExit: 4" in fault_of(leaving).message


def test_a_hook_that_yields_no_series_is_named():
    assert "TypeError" in fault_of(lambda: None).message


def test_writing_to_a_frozen_spec_is_named_and_the_remedy_is_a_copy():
    def writing():
        spec = PrimitiveSpec("mug", "a mug", MugOptions, lambda config: config)
        spec.name = "cup"
        yield spec

    fault = fault_of(writing)
    assert "FrozenInstanceError: cannot assign to field 'name'" in fault.message
    assert "make a changed copy" in fault.hint


def test_a_factory_that_raises_is_named_with_its_hook():
    def factory(config):
        raise KeyError("handle")

    with pytest.raises(PluginError) as caught:
        registered(offering(factory)).build("primitive", Choice(name="mug"))
    assert caught.value.message.startswith(
        f"{WHO}: the factory of primitive 'mug' (geoprior_primitives) raised KeyError: 'handle'"
    )
    assert isinstance(caught.value.__cause__, KeyError)


def test_a_factory_that_writes_to_its_frozen_options_is_told_to_copy():
    def factory(config):
        config.size = 2.0

    with pytest.raises(PluginError) as caught:
        registered(offering(factory)).build("primitive", Choice(name="mug"))
    assert "make a changed copy" in caught.value.hint


def test_a_factorys_own_sentence_is_left_as_it_is():
    def factory(config):
        raise ConfigError("a mug needs a handle", "set handle")

    with pytest.raises(ConfigError, match="a mug needs a handle"):
        registered(offering(factory)).build("primitive", Choice(name="mug"))


def test_a_model_that_raises_is_named():
    class Raising(MugOptions):
        def __init__(self, **values):
            super().__init__(**values)

        def model_post_init(self, context):
            raise RuntimeError("half-made")

    with pytest.raises(PluginError, match=r"the config model of primitive 'mug'.*half-made"):
        registered(offering(config=Raising)).options("primitive", Choice(name="mug"))


def test_our_own_factories_raise_what_they_raise():
    def factory(config):
        raise KeyError("handle")

    with pytest.raises(KeyError):
        registered(offering(factory), package="geoprior").build("primitive", Choice(name="mug"))


def test_an_event_hook_that_raises_is_said_once_and_called_no_more(caplog):
    calls = []

    def train_step(event):
        calls.append(event)
        raise ConnectionError("no network")

    plugins = registered(Module(geoprior_train_step=train_step))
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            plugins.hook.geoprior_train_step(event=step())
    assert len(calls) == 1
    (record,) = caplog.records
    text = record.getMessage()
    assert f"{WHO}: geoprior_train_step raised ConnectionError: no network" in text
    assert "the run goes on" in text
    assert "pip uninstall geoprior-mug" in text


def test_a_plug_in_that_is_not_let_in_hears_of_nothing():
    heard = []

    def raising():
        raise RuntimeError("no licence")

    plugins = Plugins()
    module = Module(geoprior_primitives=raising, geoprior_train_step=lambda event: heard.append(event))
    with pytest.raises(PluginError, match="no licence"):
        plugins.register(module, name="mug", package="geoprior-mug", version="1.2")
    plugins.hook.geoprior_train_step(event=step())
    assert heard == []


def test_the_other_plug_ins_still_hear_of_the_event(caplog):
    heard = []

    def train_step(event):
        raise ConnectionError("no network")

    plugins = Plugins()
    listeners = {"deaf": train_step, "good": lambda event: heard.append(event.step)}
    for name, hook in listeners.items():
        module = Module(geoprior_train_step=hook)
        plugins.register(module, name=name, package=f"geoprior-{name}", version="1")
    plugins.hook.geoprior_train_step(event=step())
    plugins.hook.geoprior_train_step(event=step())
    assert heard == [1, 1]


def test_an_event_hook_may_end_a_run_in_its_own_words():
    def train_step(event):
        raise NumericalError("the loss has not fallen for a day")

    plugins = registered(Module(geoprior_train_step=train_step))
    with pytest.raises(NumericalError, match="not fallen"):
        plugins.hook.geoprior_train_step(event=step())


def test_writing_to_an_event_is_a_fault_of_the_plug_in(caplog):
    def train_step(event):
        event.step = 5

    registered(Module(geoprior_train_step=train_step)).hook.geoprior_train_step(event=step())
    assert "FrozenInstanceError" in caplog.text


def test_two_packages_may_call_their_entry_points_the_same():
    plugins = Plugins()
    for package in ("one", "two"):
        spec = PrimitiveSpec(package, "a mug", MugOptions, print)
        module = Module(geoprior_primitives=lambda spec=spec: [spec])
        plugins.register(module, name="plugin", package=package, version="1")
    assert plugins.names("primitive") == ("one", "two")


BROKEN = {
    "import": ("import no_such_module_of_ours", "ModuleNotFoundError"),
    "syntax": ("def (", "SyntaxError"),
    "exit": ("raise SystemExit('go away')", "SystemExit: go away"),
    "hook": (
        """
        from geoprior import hookimpl
        @hookimpl
        def geoprior_primitives():
            raise RuntimeError("no licence")
        """,
        "geoprior_primitives raised RuntimeError: no licence",
    ),
    "version": (
        """
        from geoprior import PrimitiveSpec, __version__, hookimpl
        @hookimpl
        def geoprior_primitives():
            yield PrimitiveSpec(title="mug", factory=print)
        """,
        "unexpected keyword argument 'title'",
    ),
}


@pytest.fixture(scope="module")
def broken_site(tmp_path_factory):
    """All the broken packages at once, as in a bad environment."""
    site = tmp_path_factory.mktemp("broken")
    for name, (code, _) in BROKEN.items():
        install(site, f"geoprior-{name}", textwrap.dedent(code))
    return site


def test_a_config_that_does_not_use_them_runs_on(broken_site, tmp_path):
    done = geoprior(broken_site, "generate", "lite", "--out", tmp_path / "run", *SMALL)
    assert done.returncode == 0, done.stderr
    assert "geoprior-" not in done.stderr


def test_one_that_does_is_told_which_packages_did_not_load_and_why(broken_site):
    done = geoprior(broken_site, "config", "show", "--set", "generate.primitives=[mug]")
    assert done.returncode == 2
    assert "unknown primitive 'mug'" in done.stderr
    for name, (_, reason) in BROKEN.items():
        assert f"geoprior-{name} 1.2" in done.stderr
        assert reason in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", BROKEN)
def test_checking_one_says_what_to_do(broken_site, name, monkeypatch):
    monkeypatch.syspath_prepend(broken_site)
    plugins, lines = Plugins(), []
    plugins.load_entry_points()
    assert check(f"geoprior-{name}", plugins, lines.append)["failed"] == 1
    text = "\n".join(lines)
    assert BROKEN[name][1] in text
    assert f"pip uninstall geoprior-{name}" in text


def test_one_that_is_for_another_geoprior_is_told_which(tmp_path, monkeypatch):
    code = "from geoprior import MugSpec\n"
    monkeypatch.syspath_prepend(install(tmp_path, "geoprior-mug", code, "geoprior>=99"))
    plugins = Plugins()
    plugins.load_entry_points()
    (mug,) = (plugin for plugin in plugins.found if plugin.package == "geoprior-mug")
    assert "cannot import name 'MugSpec'" in mug.error
    assert f"it is for geoprior >=99, and this is {__version__}" in mug.remedy


def test_a_run_says_which_plug_in_failed_while_it_ran(tmp_path):
    """In the command line: a stage's hook that raises is said, and the stage is done all the same."""
    code = """
    from geoprior import hookimpl
    @hookimpl
    def geoprior_before_stage(event):
        raise OSError("the office is closed")
    """
    site = install(tmp_path, "geoprior-telegram", textwrap.dedent(code))
    done = geoprior(site, "generate", "lite", "--out", tmp_path / "run", *SMALL)
    assert done.returncode == 0
    assert "package 'geoprior-telegram' 1.2: geoprior_before_stage raised OSError" in done.stderr
    assert "the run goes on" in done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "run/shards/synthetic/manifest.json").is_file()


SAMPLES = """
from geoprior import PrimitiveSpec, __version__, hookimpl
from geoprior.options import Options
class Mug:
    def __init__(self, config):
        pass
    def sample(self, rng):
        return [][1]
@hookimpl
def geoprior_primitives():
    yield PrimitiveSpec("mug", "a mug", Options, Mug)
"""


@pytest.mark.parametrize("executor", ["serial", "{name: local, workers: 1}"])
def test_what_a_plug_in_raises_in_the_middle_of_its_work_is_said_in_its_name(tmp_path, executor):
    """In this process, and in a worker."""
    site = install(tmp_path, "geoprior-mug", SAMPLES)
    wanted = [
        word.replace("sphere", "mug").replace("executor=serial", f"executor={executor}") for word in SMALL
    ]
    done = geoprior(site, "generate", "lite", "--out", tmp_path / "run", *wanted)
    assert done.returncode == 3
    who = "plug-in 'geoprior_mug' of package 'geoprior-mug' 1.2"
    assert f"{who} raised IndexError: list index out of range (geoprior_mug.py, line 8)" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_run_whose_factory_raises_ends_with_code_3_and_no_traceback(tmp_path):
    code = """
    from geoprior import PrimitiveSpec, __version__, hookimpl
    from geoprior.options import Options
    def build(config):
        raise RuntimeError("no licence")
    @hookimpl
    def geoprior_primitives():
        yield PrimitiveSpec("mug", "a mug", Options, build)
    """
    site = install(tmp_path, "geoprior-mug", textwrap.dedent(code))
    wanted = [word.replace("sphere", "mug") for word in SMALL]
    done = geoprior(site, "generate", "lite", "--out", tmp_path / "run", *wanted)
    assert done.returncode == 3
    assert "package 'geoprior-mug' 1.2: the factory of primitive 'mug' (geoprior_primitives)" in done.stderr
    assert "Traceback" not in done.stderr
