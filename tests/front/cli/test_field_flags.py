"""Fields of messages become the flags of the command line, and nothing else does."""

import json

import click
import pytest

from scleraforce.base.errors import InputError
from scleraforce.front.cli.field_flags import (
    FLAGS,
    IRREGULAR,
    OF_COMMAND,
    flag_of,
    in_flags,
    json_in_flags,
)
from scleraforce.front.cli.main import COMMANDS, cli
from scleraforce.front.cli.output import Command, Report

# Options that give a field in another unit, and so under another name.
IN_UNITS = {
    "depth_mm",
    "gap_mm",
    "iop_mmhg",
    "polar_angle_deg",
    "thickness_um",
    "width_mm",
}


def options(command: str) -> list[click.Option]:
    found = cli.get_command(click.Context(cli), command)
    assert found is not None
    return [param for param in found.params if isinstance(param, click.Option)]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_table_has_the_flag_of_each_option(command: str) -> None:
    for option in options(command):
        name = option.name.rpartition(".")[2]
        assert flag_of(name, command) in option.opts, name
        assert name in {*FLAGS, *OF_COMMAND.get(command, ()), *IN_UNITS}, name


def test_the_table_has_no_flag_that_no_command_has() -> None:
    used = {
        flag for command in COMMANDS for one in options(command) for flag in one.opts
    }
    assert {*FLAGS.values()} <= used
    assert not [
        name
        for name, flag in IRREGULAR.items()
        if flag == f"--{name.replace('_', '-')}"
    ]


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("give `width_m` and `depth_m`", "give --width-mm and --depth-mm"),
        ("upside down (`flip=rows`)?", "upside down (--flip rows)?"),
        ("a.png: `frames_by`: no time", "a.png: --frames-by: no time"),
        ("give `frames_by=times:s`", "give --frames-by times:s"),
        ("give `columns=fz=NAME:UNIT` `array`", "give --column fz=NAME:UNIT --array"),
        ("or replace it (`replace`)", "or replace it (--force)"),
        ("not used by `train kind=reader`", "not used by `train --kind reader`"),
        (
            "`scleraforce library out=/a b/c` makes one",
            "`scleraforce library --out /a b/c` makes one",
        ),
    ],
)
def test_a_field_becomes_its_flag(text: str, printed: str) -> None:
    assert in_flags(text) == printed


@pytest.mark.parametrize(
    "text",
    [
        "`calibrate` needs it, `scleraforce import` writes it",
        "`nothing`, `nothing=rows`, `display_floor_db`",
        "width_m: 12 is above the largest allowed value",
        "/data/`eye`/a.png: no such file",
        "`flip`.png: no such file",
        "my`axis`.png, 'a `scan`', '`rows`'",
        "`sqlite3 whole.db3 out=a`",
    ],
)
def test_other_text_in_backquotes_stays(text: str) -> None:
    assert in_flags(text) == text


def test_a_command_has_words_of_its_own() -> None:
    assert in_flags("`columns`", "import") == "--column"
    assert in_flags("`columns`", "monitor") == "--columns"
    assert in_flags("`train` trains one", "reproduce") == "--train trains one"
    assert in_flags("`train` trains one", "train") == "`train` trains one"


def test_texts_in_json_are_translated_and_keys_and_numbers_are_not() -> None:
    found = {"`eye`": ["check `axes`", 1.5, None, True, ("`times=TABLE`",)]}
    assert json_in_flags(found) == {
        "`eye`": ["check --axes", 1.5, None, True, ["--times TABLE"]]
    }


@click.command("monitor", cls=Command)
@click.option("--rows")
@click.option("--fails", is_flag=True)
def spoken(rows: str | None, fails: bool) -> Report:
    if fails:
        raise InputError(f"rows: {rows}; give `rows` and `columns`")
    return Report({"note": f"{rows}: `width_m`"}, [f"{rows}: `width_m`"])


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        ((), "`a`.png: --width-mm"),
        (("--json",), json.dumps({"note": "`a`.png: --width-mm"}, indent=2)),
    ],
)
def test_reports_are_printed_with_flags(words, printed: str, capsys) -> None:
    spoken.main(["--rows", "`a`.png", *words], standalone_mode=False)
    assert capsys.readouterr().out == f"{printed}\n"


def test_errors_are_printed_with_flags() -> None:
    with pytest.raises(InputError) as fault:
        spoken.main(["--rows", "`a`.png", "--fails"], standalone_mode=False)
    assert str(fault.value) == "--rows: `a`.png; give --rows and --columns"
