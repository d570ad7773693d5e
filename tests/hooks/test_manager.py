import sys
import types
from importlib import metadata

import pytest

from geoprior import ExecutorSpec, PrimitiveSpec, hookimpl
from geoprior.errors import ConfigError, PluginError
from geoprior.hooks import manager as manager_module
from geoprior.hooks.manager import ALLOW_LIST, PluginConflictError, Plugins
from geoprior.options import Choice, Options


class NoOptions(Options):
    pass


class SizeOptions(Options):
    size: float = 1.0


def primitive(name, config=NoOptions):
    return PrimitiveSpec(name=name, summary="for a test", config=config, factory=lambda config: config)


def module_with(hook_name, *specs):
    def hook():
        yield from specs

    hook.__name__ = hook_name
    module = types.ModuleType("a_plugin")
    setattr(module, hook_name, hookimpl(hook))
    return module


def register(plugins, module, package="here"):
    plugins.register(module, name=f"{package}.plugin", package=package, version="1")


def entry_point(name, value, monkeypatch, **modules):
    for module_name, module in modules.items():
        monkeypatch.setitem(sys.modules, module_name, module)
    return metadata.EntryPoint(name=name, value=value, group="geoprior")


@pytest.fixture
def with_entry_points(monkeypatch):
    def install(*points):
        monkeypatch.setattr(manager_module.metadata, "entry_points", lambda group: list(points))

    return install


def test_builtins_come_through_the_same_hooks():
    plugins = Plugins()
    plugins.load_builtins()
    assert {"pick", "place", "push"} <= set(plugins.names("motion"))
    assert {"prism", "cylinder", "sphere"} <= set(plugins.names("primitive"))
    assert "points" in plugins.names("renderer")
    assert "ur5e" in plugins.names("robot")
    assert "pick" in plugins.names("task")
    assert "act" in plugins.names("policy")
    assert "local" in plugins.names("executor")
    assert all(plugin.status == "ok" for plugin in plugins.found)


def test_listing_and_checking_options_imports_nothing_heavy(run_python):
    run_python(
        "import sys\n"
        "from geoprior.hooks.manager import Plugins\n"
        "from geoprior.options import Choice\n"
        "plugins = Plugins(); plugins.load_builtins()\n"
        "for entry in plugins.registered(): plugins.resolve(entry.spec.kind, Choice(name=entry.spec.name))\n"
        "heavy = {'torch', 'mujoco', 'robosuite', 'numba', 'cv2'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )


def test_every_builtin_has_a_summary_and_documents_its_options():
    plugins = Plugins()
    plugins.load_builtins()
    for entry in plugins.registered():
        assert entry.spec.summary
        for name, field in entry.spec.config.model_fields.items():
            assert field.description, f"{entry.spec.kind} {entry.spec.name}: option {name}"


def test_a_name_taken_twice_names_both_packages():
    plugins = Plugins()
    register(plugins, module_with("geoprior_primitives", primitive("mug")), "first-package")
    with pytest.raises(PluginConflictError, match=r"'mug'.*'first-package'.*'second-package'"):
        register(plugins, module_with("geoprior_primitives", primitive("mug")), "second-package")
    assert plugins.names("primitive") == ("mug",)


def test_a_name_taken_twice_within_one_plugin_is_refused_and_leaves_nothing():
    plugins = Plugins()
    with pytest.raises(PluginConflictError):
        register(plugins, module_with("geoprior_primitives", primitive("mug"), primitive("mug")))
    assert plugins.names("primitive") == ()


def test_a_misspelt_hook_is_an_error_that_names_the_right_one():
    with pytest.raises(PluginError, match="geoprior_primitive'") as caught:
        register(Plugins(), module_with("geoprior_primitive", primitive("mug")))
    assert "geoprior_primitives" in caught.value.hint


def test_a_hook_with_wrong_arguments_is_an_error():
    def geoprior_primitives(surprise):
        return []

    module = types.ModuleType("a_plugin")
    module.geoprior_primitives = hookimpl(geoprior_primitives)
    plugins = Plugins()
    with pytest.raises(PluginError, match="surprise"):
        register(plugins, module)
    assert plugins.found == ()


def test_a_spec_of_another_kind_is_an_error():
    wrong = ExecutorSpec(name="mug", summary="", config=NoOptions, factory=lambda config: config)
    with pytest.raises(PluginError, match=r"yielded ExecutorSpec, expected PrimitiveSpec"):
        register(Plugins(), module_with("geoprior_primitives", wrong))


def test_a_broken_entry_point_does_not_stop_the_others(monkeypatch, with_entry_points):
    good = module_with("geoprior_primitives", primitive("mug"))
    with_entry_points(
        entry_point("broken", "no_such_module_of_ours", monkeypatch),
        entry_point("good", "a_good_plugin", monkeypatch, a_good_plugin=good),
    )
    plugins = Plugins()
    plugins.load_entry_points()
    assert plugins.names("primitive") == ("mug",)
    by_name = {plugin.name: plugin for plugin in plugins.found}
    assert by_name["broken"].status == "broken"
    assert "no_such_module_of_ours" in by_name["broken"].error


def test_a_config_that_needs_a_broken_plugin_says_which_one_did_not_load(monkeypatch, with_entry_points):
    with_entry_points(entry_point("broken", "no_such_module_of_ours", monkeypatch))
    plugins = Plugins()
    plugins.load_entry_points()
    with pytest.raises(ConfigError) as caught:
        plugins.spec("primitive", "mug")
    assert "broken" in caught.value.hint
    assert "no_such_module_of_ours" in caught.value.hint


def test_a_conflict_between_entry_points_is_fatal(monkeypatch, with_entry_points):
    one, two = (module_with("geoprior_primitives", primitive("mug")) for _ in range(2))
    with_entry_points(
        entry_point("one", "plugin_one", monkeypatch, plugin_one=one),
        entry_point("two", "plugin_two", monkeypatch, plugin_two=two),
    )
    with pytest.raises(PluginConflictError):
        Plugins().load_entry_points()


def test_the_allow_list_admits_only_the_named(monkeypatch, with_entry_points):
    one = module_with("geoprior_primitives", primitive("mug"))
    two = module_with("geoprior_primitives", primitive("bowl"))
    with_entry_points(
        entry_point("one", "plugin_one", monkeypatch, plugin_one=one),
        entry_point("two", "plugin_two", monkeypatch, plugin_two=two),
    )
    monkeypatch.setenv(ALLOW_LIST, "two")
    plugins = Plugins()
    plugins.load_entry_points()
    assert plugins.names("primitive") == ("bowl",)
    assert {plugin.name: plugin.status for plugin in plugins.found} == {"one": "not allowed", "two": "ok"}


def test_an_empty_allow_list_admits_nobody(monkeypatch, with_entry_points):
    one = module_with("geoprior_primitives", primitive("mug"))
    with_entry_points(entry_point("one", "plugin_one", monkeypatch, plugin_one=one))
    monkeypatch.setenv(ALLOW_LIST, "")
    plugins = Plugins()
    plugins.load_entry_points()
    assert plugins.names("primitive") == ()


def test_an_unknown_name_prints_the_choices_and_the_nearest():
    plugins = Plugins()
    register(plugins, module_with("geoprior_primitives", primitive("cylinder"), primitive("sphere")))
    with pytest.raises(ConfigError, match="unknown primitive 'cilinder'") as caught:
        plugins.build("primitive", Choice(name="cilinder"))
    assert "did you mean 'cylinder'" in caught.value.hint
    assert "sphere" in caught.value.hint


@pytest.mark.parametrize(("options", "fault"), [({"sise": 2.0}, "sise"), ({"size": "wide"}, "size")])
def test_a_wrong_option_is_named(options, fault):
    plugins = Plugins()
    register(plugins, module_with("geoprior_primitives", primitive("mug", SizeOptions)))
    with pytest.raises(ConfigError, match=f"option '{fault}'") as caught:
        plugins.build("primitive", Choice(name="mug", options=options))
    assert "size" in caught.value.hint


def test_resolving_writes_every_option_out():
    plugins = Plugins()
    register(plugins, module_with("geoprior_primitives", primitive("mug", SizeOptions)))
    assert plugins.resolve("primitive", Choice(name="mug")).options == {"size": 1.0}
