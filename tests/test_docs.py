"""What the documentation shows is there: commands parse, links lead somewhere, all that `evsdr` exports is described."""

import importlib
import re
import shlex
from importlib.util import find_spec

import pytest
import tyro

import evsdr
from tests.conftest import REPOSITORY

PAGES = [
    path
    for pattern in ("README.md", "docs/**/*.md", "experiments/**/*.md", "scenes/*.md", "firmware/*.md")
    for path in sorted(REPOSITORY.glob(pattern))
    if not path.is_relative_to(REPOSITORY / "docs" / "made")
]
BLOCK = re.compile(r"^```\w*\n(.*?)^```|^((?: {4}.*\n)+)", re.DOTALL | re.MULTILINE)
RUN = re.compile(r"^ *(?:\$ )?(?:python -m |make )[^#\n]*", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)\s]*)?\)")
TARGETS = set(re.findall(r"^(\w+):", (REPOSITORY / "Makefile").read_text(), re.MULTILINE))


def commands() -> list[str]:
    """Give what stands in the code blocks of all pages, each command once."""
    blocks = [a or b for page in PAGES for a, b in BLOCK.findall(page.read_text())]
    lines = [line.strip() for block in blocks for line in RUN.findall(block.replace("\\\n", " "))]
    return sorted({line for line in lines if not {"DIR", "..."} & set(line.split())})


@pytest.fixture
def parsed(monkeypatch):
    """Give a function that parses a command of evsdr and runs nothing; it gives the options."""

    def parse(name: str, argv: list[str]):
        module, options = importlib.import_module(f"evsdr.commands.{name}"), []

        def run(_, options_type, command, argv) -> None:
            options.append(tyro.cli(options_type, args=argv, config=(tyro.conf.AvoidSubcommands,)))

        monkeypatch.setattr(module, "run_command", run)
        module.main(argv)
        return options[0]

    return parse


def test_commands_parse(parsed):
    """As they stand there, options and all; experiments and targets of make exist."""
    found = commands()
    assert len(found) > 40
    for line in found:
        program, *words = shlex.split(line.removeprefix("$ "))
        if program == "make":
            names = [word for word in words if "=" not in word and not word.startswith("-")]
            assert "-C" in words or set(names) <= TARGETS, line
            continue
        package, _, name = words[1].partition(".")
        if package == "evsdr" and "--help" not in words and find_spec(f"evsdr.commands.{name}"):
            try:
                parsed(name, words[2:])
            except SystemExit:
                pytest.fail(f"does not parse: {line}")
        else:
            assert find_spec(words[1]), line


def test_links_lead_somewhere():
    """To files of the checkout; `docs/made` is written by Sphinx."""
    for page in PAGES:
        for target in LINK.findall(re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)):
            assert target.startswith("made/") or (page.parent / target).exists(), f"{page}: {target}"


def test_all_that_is_exported_is_described():
    described = set(re.findall(r"auto\w+:: (\w+)", (REPOSITORY / "docs" / "python.md").read_text()))
    assert described == set(evsdr.__all__)
