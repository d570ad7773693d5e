"""Write a new package beside nothing that is there: from the templates, under the user's name."""

from __future__ import annotations

import keyword
import shutil
import tempfile
from importlib import metadata, util
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import jinja2

from geoprior import __version__
from geoprior.config import KINDS, RunConfig
from geoprior.errors import ConfigError, DataError
from geoprior.hooks.door import NAME
from geoprior.hooks.manager import HOOK_OF_KIND, SPEC_OF_HOOK, Plugins

_TEMPLATES = "geoprior.authoring.scaffold.templates"
_AROUND = ("pyproject.toml", "README.md", "tests/test_contract.py")
"""Files of every package, beside its modules."""


def write_package(name: str, kind: str, out: Path, plugins: Plugins) -> Path:
    """Write a package that adds one plug-in.

    Args:
        name: What a config will call it; ``geoprior-`` before it is dropped.
        kind: A key of `geoprior.hooks.manager.HOOK_OF_KIND`.
        out: Where the package's folder goes.
        plugins: Whose names are taken.

    Returns:
        The new folder, ``geoprior-NAME``.

    Raises:
        ConfigError: The name cannot be one, or it is taken; or there is no such kind.
        DataError: The folder is there already, or cannot be written.
    """
    name = name.removeprefix("geoprior-")
    if kind not in HOOK_OF_KIND:
        raise ConfigError(f"{kind!r} is no kind of plug-in", f"the kinds are {', '.join(HOOK_OF_KIND)}")
    _refuse_bad_names(name)
    _refuse_taken_names(name, kind, plugins)
    folder = out / f"geoprior-{name}"
    if folder.exists():
        raise DataError(f"{folder}: is there already", "choose another name, or move it away")
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out, prefix=".geoprior-new-") as scratch:
            draft = Path(scratch) / folder.name
            _fill(draft, name, kind)
            draft.rename(folder)
    except OSError as error:
        raise DataError(
            f"{folder}: cannot be written: {error}", "choose another folder with --out"
        ) from error
    return folder


def next_commands(folder: Path) -> tuple[str, ...]:
    """What to type next: install it, check it, run its own tests."""
    return (
        f"pip install -e {folder if folder.is_absolute() else f'./{folder}'}",
        f"geoprior plugins check {folder.name}",
        f"pytest {folder}",
    )


def _refuse_bad_names(name: str) -> None:
    remedy = "take lower-case letters, digits and single dashes, a letter first"
    if not NAME.fullmatch(name) or not name[0].isalpha():
        likely = "-".join("".join(c if c.isalnum() and c.isascii() else " " for c in name.lower()).split())
        near = likely.lstrip("0123456789-")
        raise ConfigError(
            f"{name!r} cannot be the name of a plug-in and of a package",
            f"{remedy}{f', for example {near!r}' if near else ''}",
        )
    if keyword.iskeyword(name):
        raise ConfigError(f"{name!r} is a word of Python", remedy)


def _refuse_taken_names(name: str, kind: str, plugins: Plugins) -> None:
    if name in plugins.names(kind):
        owner = plugins.plugin_of(kind, name)
        raise ConfigError(
            f"the {kind} {name!r} is taken by package {owner.package!r} {owner.version}",
            "choose another name",
        )
    package, module = f"geoprior-{name}", _module(name)
    try:
        version = metadata.version(package)
    except metadata.PackageNotFoundError:
        version = ""
    if version or util.find_spec(module) is not None:
        raise ConfigError(
            f"a package {package!r} {version}".rstrip() + " is installed already",
            f"choose another name, or `pip uninstall {package}`",
        )


def _fill(folder: Path, name: str, kind: str) -> None:
    module = _module(name)
    with as_file(files(_TEMPLATES)) as templates:
        shutil.copytree(
            templates / kind, folder / module, ignore=shutil.ignore_patterns("__pycache__", "own_test.py")
        )
        for path in (folder / module).glob("*.py"):
            path.write_text(_renamed(path.read_text(encoding="utf-8"), name, kind), encoding="utf-8")
        words = _words(name, kind)
        environment = jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True)  # noqa: S701 - no HTML
        for relative in _AROUND:
            text = (templates / "around" / f"{Path(relative).name}.jinja").read_text(encoding="utf-8")
            path = folder / relative
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(environment.from_string(text).render(words), encoding="utf-8")
        own = templates / kind / "own_test.py"
        if own.is_file():
            text = _renamed(own.read_text(encoding="utf-8"), name, kind)
            (folder / "tests" / f"test_{module.removeprefix('geoprior_')}.py").write_text(
                text, encoding="utf-8"
            )


def _renamed(text: str, name: str, kind: str) -> str:
    """A template's text under the new names."""
    title = "".join(part.capitalize() for part in name.split("-"))
    words = {
        f"{_TEMPLATES}.{kind}": _module(name),
        "my-plugin": name,
        "MyPlugin": title,
        "MY_PLUGIN": name.replace("-", "_").upper(),
        "My-plugin": name.capitalize(),
    }
    for old, new in words.items():
        text = text.replace(old, new)
    return text


def _words(name: str, kind: str) -> dict[str, Any]:
    return {
        "name": name,
        "package": f"geoprior-{name}",
        "module": _module(name),
        "kind": kind,
        "hook": HOOK_OF_KIND[kind],
        "spec": SPEC_OF_HOOK[HOOK_OF_KIND[kind]].__name__,
        "setting": _setting(name, kind),
        "geoprior": __version__,
    }


def _setting(name: str, kind: str) -> str:
    """What to write after ``--set`` to get it, as the config's own table of names says."""
    keys = min((keys for keys, its_kind in KINDS.items() if its_kind == kind), key=len)
    value: Any = RunConfig().model_dump(mode="json")
    for key in keys:
        value = value[key]
    return f"{'.'.join(keys)}={f'[{name}]' if isinstance(value, list) else name}"


def _module(name: str) -> str:
    return f"geoprior_{name.replace('-', '_')}"
