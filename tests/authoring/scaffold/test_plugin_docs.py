"""docs/plugins.md says what is so: every hook, every contract, and a walk that can be walked."""

from __future__ import annotations

import ast
import inspect
import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest

from geoprior.authoring.conformance import common
from geoprior.hooks import specs
from geoprior.hooks.manager import HOOK_OF_KIND

PAGE = (Path(__file__).parents[3] / "docs" / "plugins.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, flags=re.DOTALL)


def signatures(source):
    return [
        ast.unparse(
            ast.FunctionDef(node.name, node.args, [ast.Expr(ast.Constant(...))], [], node.returns, lineno=0)
        )
        for node in ast.parse(source).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("geoprior_")
    ]


def test_every_hook_stands_there_with_its_exact_signature_in_the_same_order():
    told = [signature for block in blocks("python") for signature in signatures(block)]
    assert told == signatures(inspect.getsource(specs))


@pytest.mark.parametrize("kind", HOOK_OF_KIND)
def test_every_sentence_of_a_contract_stands_under_its_kind(kind):
    module = import_module(f"geoprior.authoring.conformance.kinds.{kind}")
    title = module.__doc__.split(":")[0]
    section = PAGE.split(f"**{title}**")[1].split("\n**")[0]
    told = [line.removeprefix("- ") for line in section.splitlines() if line.startswith("- ")]
    assert told == [check.sentence for check in module.CHECKS]


def test_what_holds_of_every_kind_stands_there():
    told = PAGE.split("Of every kind:")[1].split("\n**")[0]
    assert [line for line in told.splitlines() if line] == [f"- {check.sentence}" for check in common.CHECKS]


def test_the_walk_from_an_empty_folder_can_be_walked(environment, tmp_path):
    """Its commands in their order, and its change of the module where it stands."""
    for language, text in re.findall(r"```(console|diff)\n(.*?)```", PAGE, flags=re.DOTALL):
        if language == "diff":
            old, new = (line[1:] for line in text.splitlines())
            module = tmp_path / "geoprior-mug" / "geoprior_mug" / "__init__.py"
            assert old in module.read_text()
            module.write_text(module.read_text().replace(old, new))
            continue
        for line in text.splitlines():
            program, *arguments = shlex.split(line.removeprefix("$ "))
            environment.do(program, *arguments, cwd=tmp_path)
    assert list((tmp_path / "pictures").glob("*.png"))
    assert (tmp_path / "runs/mug/shards/synthetic/manifest.json").is_file()
