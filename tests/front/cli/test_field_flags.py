"""Fields of messages become the flags of the command line, and nothing else does."""

import click
import pytest

from scleraforce.front.cli.field_flags import flag_of, in_flags, json_in_flags
from scleraforce.front.cli.main import COMMANDS, cli


@pytest.mark.parametrize("command", COMMANDS)
def test_messages_have_the_flag_of_each_option(command: str) -> None:
    found = cli.get_command(click.Context(cli), command)
    assert found is not None
    for option in found.params:
        if isinstance(option, click.Option):
            name = (option.name or "").rpartition(".")[2]
            assert flag_of(name, command) in option.opts, name


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("give `width_m` and `depth_m`", "give --width-mm and --depth-mm"),
        ("upside down (`flip=rows`)?", "upside down (--flip rows)?"),
        ("give `frames_by=times:s`", "give --frames-by times:s"),
        ("give `columns=fz=NAME:UNIT` `array`", "give --column fz=NAME:UNIT --array"),
        ("or replace it (`replace`)", "or replace it (--force)"),
        ("not used by `train kind=reader`", "not used by `train --kind reader`"),
        (
            "`scleraforce library out=/a b/c` makes one",
            "`scleraforce library --out /a b/c` makes one",
        ),
        # other text in backquotes
        ("`calibrate` needs it, `scleraforce import` writes it", None),
        ("`nothing`, `nothing=rows`, `display_floor_db`", None),
        ("width_m: 12 is above the largest allowed value", None),
        ("/data/`eye`/a.png: no such file", None),
        ("`flip`.png: no such file", None),
        ("my`axis`.png, 'a `scan`', '`rows`'", None),
        ("`sqlite3 whole.db3 out=a`", None),
    ],
)
def test_a_field_becomes_its_flag_and_other_text_stays(
    text: str, printed: str | None
) -> None:
    assert in_flags(text) == (text if printed is None else printed)


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


def test_errors_are_printed_with_flags_and_names_of_files_as_they_are(shell) -> None:
    error = shell.refused("segment '`rows`.png' --out new")
    assert error.startswith("error: `rows`.png: ")
