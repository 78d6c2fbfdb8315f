"""`scleraforce init`: write the paper's study, commented."""

from pathlib import Path

import click

from scleraforce.cli.options import PATH
from scleraforce.cli.output import Command, Report
from scleraforce.errors import StudyError
from scleraforce.study import PRESETS, preset_toml


@click.command(cls=Command)
@click.argument("directory", type=PATH)
@click.option("--preset", type=click.Choice(PRESETS), default=PRESETS[0], show_default=True,
              help="Eyes to begin with: the paper's, or at living pressure and stiffness.")  # fmt: skip
def init(directory: Path, preset: str) -> Report:
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
    return Report({"path": str(path), "preset": preset}, [f"wrote {path}"])
