"""`scleraforce init`: write the paper's study, commented."""

from pathlib import Path

import click

from scleraforce.cli.output import print_json, say
from scleraforce.errors import StudyError
from scleraforce.study import PRESETS, preset_toml


@click.command()
@click.argument("directory", type=click.Path(path_type=Path))
@click.option("--preset", type=click.Choice(PRESETS), default=PRESETS[0], show_default=True,
              help="Eyes to begin with: the paper's, or at living pressure and stiffness.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def init(directory: Path, preset: str, as_json: bool) -> None:
    """Write DIRECTORY/study.toml, the paper's study or another preset, with comments."""
    path = directory / "study.toml"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(preset_toml(preset))
    except FileExistsError as fault:
        raise StudyError(f"{path}: exists already; remove it or choose another directory") from fault
    except OSError as fault:
        raise StudyError(f"{path}: {fault.strerror}") from fault
    if as_json:
        print_json({"path": str(path), "preset": preset})
    else:
        say(f"wrote {path}")
